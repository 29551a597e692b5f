"""A decoder that dies of some files, for the process that reads files."""

from __future__ import annotations

import os
from pathlib import Path

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.files.raster import RawImage, read_pixels

PATTERN = "kills"


def read_or_die(path: Path, header: ImageHeader) -> RawImage:
    """As `raster.read_pixels`, but for the names with `PATTERN`."""
    if PATTERN in path.name:
        os.abort()
    return read_pixels(path, header)
