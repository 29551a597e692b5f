"""8-bit grey pixels as the bytes of an image file."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array

LOSSLESS_SUFFIXES = (".png", ".tif", ".tiff")


def encode_grey8(pixels: Array, suffix: str) -> bytes:
    """(H, W) uint8 as the bytes of a PNG or TIFF file."""
    import io

    buffer = io.BytesIO()
    if suffix.lower() == ".png":
        from PIL import Image

        Image.fromarray(np.ascontiguousarray(pixels), mode=None).save(
            buffer, format="png", compress_level=3
        )
    else:
        import tifffile

        tifffile.imwrite(
            buffer, np.ascontiguousarray(pixels), photometric="minisblack", compression="zlib",
            metadata=None,
        )  # fmt: skip
    return buffer.getvalue()
