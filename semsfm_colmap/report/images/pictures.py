"""Images as small as a page with hundreds of them needs: WebP, one width for the whole series.

The budget is shared: the widest pictures whose bytes fit it, judged on a few images of the series,
since all frames of one series compress alike.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Sequence

import numpy as np

from semsfm_colmap.types import Array

WIDTHS_PX = (1280, 1120, 960, 800, 720, 640, 560, 480, 400, 320, 256, 192, 160)
QUALITY = 55
"""Of 100: the noise of SEM images is most of their bytes and tells nothing here."""
NUM_TRIED = 3
Color = Callable[[Array], Array]


def shrunk(pixels: Array, width_px: int) -> Array:
    """An image of a lesser width, each pixel the mean of what it covers; never enlarged."""
    import cv2

    height, width = pixels.shape[:2]
    if width <= width_px:
        return pixels
    size = (width_px, max(1, round(height * width_px / width)))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


def webp(pixels: Array, quality: int = QUALITY) -> bytes:
    """(H, W), (H, W, 3) or (H, W, 4) uint8 as WebP."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(buffer, "WEBP", quality=quality, method=3)
    return buffer.getvalue()


def data_uri(picture: bytes) -> str:
    """A WebP picture as an address that needs no file."""
    return "data:image/webp;base64," + base64.b64encode(picture).decode("ascii")


def width_within(
    budget_bytes: float,
    num: int,
    encoded: Sequence[Callable[[int], bytes]],
    widths_px: Sequence[int] = WIDTHS_PX,
) -> int:
    """The largest width at which `num` pictures take no more than the budget.

    Parameters
    ----------
    encoded : some of the pictures, as functions from a width in px to the encoded bytes

    """
    for width in widths_px[:-1]:
        size = sum(len(encode(width)) for encode in encoded) / len(encoded)
        if size * num <= budget_bytes:
            return width
    return widths_px[-1]


def spread(num: int, wanted: int = NUM_TRIED) -> list[int]:
    """A few of so many things, spread evenly."""
    return sorted({int(k) for k in np.linspace(0, num - 1, min(num, wanted))})
