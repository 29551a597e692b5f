"""Images made ready for alignment: what is finer than shading and coarser than noise."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from semsfm_colmap.types import Array

NOISE_PX = 0.8
"""Standard deviation of the blur against pixel noise; also keeps cubic interpolation exact."""
MAX_BYTES_KEPT = 256 << 20
"""Of filtered images: those of a series of 85 of a megapixel, each."""


def band_pass(image: Array, high_pass_px: float) -> Array:
    """Difference of the image blurred by NOISE_PX and by both blurs after one another, float32.

    The secant law brightens slopes: wherever relief or the whole body turns, coarse brightness
    moves over the surface, and pulls every feature with it. What is left above `high_pass_px` is
    fixed to the surface.
    """
    import cv2

    pixels = image.astype(np.float32)
    fine = pixels - cv2.GaussianBlur(pixels, (0, 0), high_pass_px)
    return np.asarray(cv2.GaussianBlur(fine, (0, 0), NOISE_PX))


class FilteredImages:
    """The band-passed images of a series, the last ones kept: a pass asks for each three times.

    Pickled without them.

    Parameters
    ----------
    read_image : number -> pixels (H, W)
    max_bytes : of what is kept

    """

    def __init__(self, read_image: Callable[[int], Array], max_bytes: int = MAX_BYTES_KEPT) -> None:
        self._read_image = read_image
        self._max_bytes = max_bytes
        self._kept: OrderedDict[tuple[int, float], Array] = OrderedDict()

    def __reduce__(self) -> tuple[object, ...]:
        return FilteredImages, (self._read_image, self._max_bytes)

    def __call__(self, i: int, high_pass_px: float) -> Array:
        """`band_pass` of image i, not to be written to."""
        key = (int(i), high_pass_px)
        image = self._kept.pop(key, None)
        if image is None:
            image = band_pass(self._read_image(int(i)), high_pass_px)
            image.flags.writeable = False
        self._kept[key] = image
        while len(self._kept) > 1 and sum(k.nbytes for k in self._kept.values()) > self._max_bytes:
            self._kept.popitem(last=False)
        return image
