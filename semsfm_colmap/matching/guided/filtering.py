"""Images made ready for alignment: what is finer than shading and coarser than noise."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array

NOISE_PX = 0.8
"""Standard deviation of the blur against pixel noise; also keeps cubic interpolation exact."""


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
