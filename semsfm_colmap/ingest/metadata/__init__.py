"""What microscopes write beside the pixels: one module per vendor, one registry."""

from semsfm_colmap.ingest.metadata.reading import MetadataReading
from semsfm_colmap.ingest.metadata.registry import read_metadata

__all__ = ["MetadataReading", "read_metadata"]
