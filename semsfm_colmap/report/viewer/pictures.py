"""Textures and images as compressed files within the packed scene."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

import numpy as np

from semsfm_colmap.types import Array

JPEG_QUALITY = 90
PICTURE_QUALITY = 75
MAX_PICTURE_PX = 800
MIN_PICTURE_PX = 64
"""Longer side of an image of the series in a page: what the viewer blends over the surface."""
SHRINK = 0.8


def encoded(pixels: Array, *, lossless: bool, quality: int = JPEG_QUALITY) -> tuple[bytes, str]:
    """A picture (H, W) or (H, W, 3) uint8 as PNG or JPEG, and its media type.

    What is grey in all three channels is stored as grey.
    """
    import PIL.Image

    if pixels.ndim == 3 and np.array_equal(pixels[..., 0], pixels[..., 1]):
        pixels = pixels[..., 0] if np.array_equal(pixels[..., 0], pixels[..., 2]) else pixels
    out = io.BytesIO()
    image = PIL.Image.fromarray(np.ascontiguousarray(pixels))
    if lossless:
        image.save(out, format="PNG")
        return out.getvalue(), "image/png"
    image.save(out, format="JPEG", quality=quality, optimize=True)
    return out.getvalue(), "image/jpeg"


def reduced(pixels: Array, max_side_px: int) -> Array:
    """A picture (H, W) whose longer side has at most so many pixels."""
    import PIL.Image

    side = max(pixels.shape)
    if side <= max_side_px:
        return pixels
    size = [max(1, round(n * max_side_px / side)) for n in (pixels.shape[1], pixels.shape[0])]
    image = PIL.Image.fromarray(np.ascontiguousarray(pixels))
    return np.asarray(image.resize((size[0], size[1]), PIL.Image.Resampling.LANCZOS))


def series_pictures(
    names: Sequence[str], read: Callable[[str], Array | None], max_bytes: int
) -> list[bytes | None]:
    """The images of a series as JPEG, all of one size, and all together within a limit.

    None for an image that is not there; none at all where even small ones do not fit.
    """
    side = MAX_PICTURE_PX
    while side >= MIN_PICTURE_PX:
        found: list[bytes | None] = []
        total = 0
        for name in names:
            pixels = read(name)
            if pixels is None:
                found.append(None)
                continue
            data, _ = encoded(reduced(pixels, side), lossless=False, quality=PICTURE_QUALITY)
            found.append(data)
            total += len(data)
            if total > max_bytes:
                break
        if total <= max_bytes:
            return found
        side = int(side * SHRINK)
    return [None] * len(names)
