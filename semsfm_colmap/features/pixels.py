"""Images as the detectors see them: float32, mean 0, deviation 1, gain and offset gone."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.types import Array, Bool

MIN_DEVIATION_GREY = 0.5
"""Images with less contrast (grey levels) are flat but for rounding: it is not stretched further"""


def normalized_pixels(image: Array, mask: Bool | None = None) -> Array:
    """Subtract the mean and divide by the standard deviation, both of the unmasked pixels.

    Parameters
    ----------
    image : (H, W) grey, any number type
    mask : (H, W) True where usable

    Returns
    -------
    (H, W) float32, C-contiguous

    """
    if image.ndim != 2:
        raise UsageError(f"{image.shape=} but expected a grey image (H, W)")
    if mask is not None and mask.shape != image.shape:
        raise UsageError(f"{mask.shape=} but the image has {image.shape=}")
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    usable = pixels if mask is None else pixels[mask]
    if usable.size == 0:
        return np.zeros_like(pixels)
    mean = float(usable.mean(dtype=np.float64))
    deviation = float(usable.std(dtype=np.float64))
    return np.asarray((pixels - np.float32(mean)) / np.float32(max(deviation, MIN_DEVIATION_GREY)))


def distance_to_unusable(shape: tuple[int, int], mask: Bool | None) -> Array:
    """(H, W) float32 px from each pixel's centre to the nearest masked pixel or the border."""
    import cv2

    usable = np.zeros((shape[0] + 2, shape[1] + 2), dtype=np.uint8)
    usable[1:-1, 1:-1] = 1 if mask is None else mask
    distance = cv2.distanceTransform(usable, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance[1:-1, 1:-1], dtype=np.float32)
