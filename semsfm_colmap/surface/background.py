"""Which pixels of an image show no specimen, although a stereo window beside it finds a depth.

Windows that straddle a silhouette match on the bright edge alone and give the dark pixels next to
it the edge's depth: a halo of the window's radius around everything. Where a large region finds no
correlation at any depth it is background; a pixel near it whose grey lies on the background's side
of half-way between the local background and the local specimen belongs to it. An image that the
specimen fills has no such region and loses nothing.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array, Bool

_MIN_REGION = 0.002
"""Share of the image that an uncorrelated region must cover to count as background."""
_MIN_CONTRAST_SIGMA = 4.0
"""Specimen and background must differ by this many deviations of the noise to be told apart."""


def background(grey: Array, correlation: Array, noise: float, radius: int) -> Bool:
    """Pixels that belong to the background: (H, W) bool.

    Parameters
    ----------
    grey : (H, W) float32
    correlation : (H, W) best mean correlation over all depths, 0..1
    noise : deviation of the pixel noise
    radius : px, how far a halo can reach

    """
    import cv2

    size = 2 * radius + 1
    smooth = cv2.blur(correlation.astype(np.float32), (size, size))
    empty = (smooth < _UNCORRELATED).astype(np.uint8)
    count, label, stats, _ = cv2.connectedComponentsWithStats(empty, connectivity=4)
    large = np.asarray(stats[:, cv2.CC_STAT_AREA] >= _MIN_REGION * grey.size)
    large[0] = False
    sure = large[label] if count > 1 else np.zeros(grey.shape, dtype=bool)
    if not sure.any():
        return np.asarray(sure)

    # local means of the two sides over a neighbourhood that reaches across the halo
    reach = (6 * radius + 1, 6 * radius + 1)
    outside = sure.astype(np.float32)
    near = cv2.dilate(outside, np.ones((4 * radius + 1,) * 2)) > 0
    inside = (~near).astype(np.float32)
    rim = ((smooth > _CORRELATED) & ~sure).astype(np.float32)
    weight_b = cv2.blur(outside, reach)
    weight_s = cv2.blur(np.maximum(rim, inside), reach)
    dark = cv2.blur(grey * outside, reach) / np.maximum(weight_b, 1e-6)
    bright = cv2.blur(grey * np.maximum(rim, inside), reach) / np.maximum(weight_s, 1e-6)
    contrast = bright - dark
    known = (weight_b > 1e-3) & (weight_s > 1e-3) & (contrast > _MIN_CONTRAST_SIGMA * noise)
    calm = cv2.GaussianBlur(grey, (0, 0), 0.7)
    like_background = known & near & (calm < dark + 0.5 * contrast)
    return np.asarray(sure | like_background)


_UNCORRELATED = 0.35
_CORRELATED = 0.6
"""Means over a window of the best correlation: noise reaches 0.2 to 0.3, texture 0.7 and more."""
