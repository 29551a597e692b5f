"""Header and pixels of an image file of others, read in a process that may die of them.

What is read there is `raster.py`. A crafted file that ends its decoder, one that never comes to an
end and a decompression bomb are named like any other damaged file.
"""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.ingest.files import raster
from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.io.apart import Allowance, DiedError, call_apart

SECONDS = 30
"""Of processor time for any image, and one more for each million pixels: the slowest decoder,
JPEG 2000, takes a tenth of that."""
BASE_BYTES = 1 << 30
BYTES_PER_PIXEL = 128
"""Colours as float64 before they become grey, several times."""
COPIES = 4
"""Of the stored samples: as they are decoded, turned, without alpha."""


def read_header(path: Path, max_pixels: int) -> ImageHeader:
    """Format, size and depth of a file, or `UnreadableImageError`."""
    allowance = Allowance(seconds=SECONDS, num_bytes=BASE_BYTES)
    try:
        return call_apart(allowance, raster.read_header, path.absolute(), max_pixels)
    except DiedError as died:
        raise UnreadableImageError(
            f"the header ended the process that read it ({died}); the file is damaged."
        ) from died


def read_pixels(path: Path, header: ImageHeader) -> RawImage:
    """Decode the image that `header` describes to grey, or `UnreadableImageError`."""
    num_pixels = header.width * header.height
    stored = num_pixels * header.channels * max(header.bits, 8) // 8
    allowance = Allowance(
        seconds=SECONDS + num_pixels // 1_000_000,
        num_bytes=BASE_BYTES + BYTES_PER_PIXEL * num_pixels + COPIES * stored,
    )
    try:
        return call_apart(allowance, raster.read_pixels, path.absolute(), header)
    except DiedError as died:
        raise UnreadableImageError(
            f"the pixels ended the process that decoded them ({died}); the file is damaged, or "
            "holds more than its header says."
        ) from died
