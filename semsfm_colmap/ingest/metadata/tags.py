"""Raw bytes of the private tags of a TIFF, bounded, without interpreting them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semsfm_colmap.ingest.files.tiff import open_tiff
from semsfm_colmap.ingest.metadata.text import MAX_TEXT_BYTES

ZEISS = 34118
FEI_SFEG = 34680
FEI_HELIOS = 34682
FEI_XML = 34683
TESCAN = 50431
VENDOR_TAGS = (ZEISS, FEI_SFEG, FEI_HELIOS, FEI_XML, TESCAN)
DESCRIPTION = 270


def read_raw_tags(path: Path, page: int) -> dict[int, bytes]:
    """Bytes of the vendor tags and of the description of one page."""
    tags: dict[int, bytes] = {}
    with open_tiff(path) as tiff:
        for tag in tiff.pages[page].tags:
            if tag.code in VENDOR_TAGS or tag.code == DESCRIPTION:
                tags.setdefault(tag.code, _raw_bytes(tiff.filehandle, tag))
    return tags


def _raw_bytes(file: Any, tag: Any) -> bytes:
    size = min(int(tag.valuebytecount), MAX_TEXT_BYTES)
    if tag.valueoffset < 0 or tag.valueoffset + size > file.size:
        return b""
    file.seek(tag.valueoffset)
    return bytes(file.read(size))
