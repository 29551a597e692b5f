"""Which vendor wrote a file: try each reader on what it recognises."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from semsfm_colmap.ingest.metadata import fei, zeiss
from semsfm_colmap.ingest.metadata.reading import MetadataReading
from semsfm_colmap.ingest.metadata.tags import FEI_HELIOS, FEI_SFEG, FEI_XML, ZEISS, read_raw_tags
from semsfm_colmap.ingest.raster import ImageHeader

Reader = Callable[[dict[int, bytes], ImageHeader], MetadataReading]
BY_TAG: dict[int, Reader] = {
    ZEISS: zeiss.read,
    FEI_HELIOS: fei.read,
    FEI_SFEG: fei.read,
    FEI_XML: fei.read,
}


def read_metadata(path: Path, header: ImageHeader) -> MetadataReading:
    """What is recorded in or beside a file; an empty reading where nothing is.

    Headers are foreign data: whatever goes wrong in one becomes a warning of its file.
    """
    try:
        tags = read_raw_tags(path, header.page) if header.format == "tiff" else {}
    except Exception as error:  # a hostile directory may raise anything
        return MetadataReading(warnings=(f"the TIFF tags cannot be read ({error})",))
    for code, reader in BY_TAG.items():
        if code in tags:
            return reader(tags, header)
    return MetadataReading()
