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
FIBICS = 51023
VENDOR_TAGS = (ZEISS, FEI_SFEG, FEI_HELIOS, FEI_XML, TESCAN, FIBICS)
DESCRIPTION = 270
X_RESOLUTION = 282
RESOLUTION_UNIT = 296
DM_UNIT, DM_SCALE = 65003, 65009
"""Gatan's DigitalMicrograph: the unit and the size of a pixel along x."""
CALIBRATION_TAGS = (DESCRIPTION, X_RESOLUTION, RESOLUTION_UNIT, DM_UNIT, DM_SCALE)


def read_raw_tags(path: Path, page: int) -> dict[int, bytes]:
    """Bytes of the vendor tags and of those of the calibration of one page.

    Numbers of the resolution are little-endian, whatever the file is.
    """
    tags: dict[int, bytes] = {}
    with open_tiff(path) as tiff:
        for tag in tiff.pages[page].tags:
            if tag.code in VENDOR_TAGS or tag.code in CALIBRATION_TAGS:
                raw = _raw_bytes(tiff.filehandle, tag)
                if tag.code == X_RESOLUTION and tiff.byteorder == ">":
                    raw = raw[3::-1] + raw[7:3:-1]
                tags.setdefault(tag.code, raw)
    return tags


def _raw_bytes(file: Any, tag: Any) -> bytes:
    size = min(int(tag.valuebytecount), MAX_TEXT_BYTES)
    if tag.valueoffset < 0 or tag.valueoffset + size > file.size:
        return b""
    file.seek(tag.valueoffset)
    return bytes(file.read(size))
