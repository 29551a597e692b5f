"""What is recorded in or beside a file."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.ingest.files.raster import read_header
from semsfm_colmap.ingest.metadata import MetadataReading, read_metadata


def read(path: Path) -> MetadataReading:
    return read_metadata(path, read_header(path, 10**9))
