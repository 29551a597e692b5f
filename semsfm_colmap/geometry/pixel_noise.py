"""The noise of single pixels, told from an image alone [Immerkaer 1996].

The mask ``[[1, -2, 1], [-2, 4, -2], [1, -2, 1]]`` removes slopes and edges along x and y; its
response to white noise has 6 times the noise's standard deviation. Texture responds, too, so a
robust measure of the response is taken: which one depends on what the image is expected to hold.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array

MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
MASK_NORM = 6.0
GAUSSIAN_MEDIAN = 0.6745
"""Median absolute value of a Gaussian, in standard deviations."""
QUIET_PX = 15
QUIET_PART = 0.1


def noise_level(grey: Array) -> float:
    """Standard deviation of the noise in (H, W) by the median response, which resists texture."""
    return float(np.median(_response(grey))) / (GAUSSIAN_MEDIAN * MASK_NORM)


def quiet_noise_level(grey: Array) -> float:
    """Standard deviation of the noise in (H, W) at the quietest tenth of the image.

    The local means of the response are sorted and the 10 % quantile taken, which is noise wherever
    the image has some smooth area.
    """
    import cv2

    local = cv2.blur(_response(grey), (QUIET_PX, QUIET_PX))
    return float(np.sqrt(np.pi / 2.0) / MASK_NORM * np.quantile(local, QUIET_PART))


def _response(grey: Array) -> Array:
    """Absolute response (H, W) float32 to the mask."""
    import cv2

    return np.abs(cv2.filter2D(grey.astype(np.float32), -1, MASK))
