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
_UNCORRELATED = 0.35
"""Mean of the best correlation over a window: noise reaches 0.2 to 0.3, texture 0.6 and more."""


def uncorrelated_region(correlation: Array, radius: int) -> Bool:
    """Large regions where nothing correlates at any depth: (H, W) -> (H, W) bool.

    `correlation` is the best one over all depths, `radius` that of the window it is averaged over.
    """
    import cv2

    size = 2 * radius + 1
    empty = (cv2.blur(correlation, (size, size)) < _UNCORRELATED).astype(np.uint8)
    count, label, stats, _ = cv2.connectedComponentsWithStats(empty, connectivity=4)
    large = np.asarray(stats[:, cv2.CC_STAT_AREA] >= _MIN_REGION * empty.size)
    large[0] = False
    return large[label] if count > 1 else np.zeros(empty.shape, dtype=bool)


def background(grey: Array, empty: Bool, halo: int, noise: float) -> Bool:
    """Pixels that belong to the background: (H, W) bool.

    Parameters
    ----------
    grey : (H, W) float32
    empty : (H, W) from `uncorrelated_region`
    halo : px, how far beyond a silhouette windows still correlate
    noise : deviation of the pixel noise

    """
    import cv2

    if not empty.any():
        return empty
    # local means of the two sides over a neighbourhood that reaches across the halo
    reach = (6 * halo + 1, 6 * halo + 1)
    outside = empty.astype(np.float32)
    near = cv2.dilate(outside, np.ones((4 * halo + 1, 4 * halo + 1))) > 0
    inside = (~(cv2.dilate(outside, np.ones((2 * halo + 1, 2 * halo + 1))) > 0)).astype(np.float32)
    weight_out, weight_in = cv2.blur(outside, reach), cv2.blur(inside, reach)
    dark = cv2.blur(grey * outside, reach) / np.maximum(weight_out, 1e-6)
    bright = cv2.blur(grey * inside, reach) / np.maximum(weight_in, 1e-6)
    contrast = bright - dark
    known = (weight_out > 1e-3) & (weight_in > 1e-3) & (contrast > _MIN_CONTRAST_SIGMA * noise)
    calm = cv2.GaussianBlur(grey, (0, 0), 0.7)
    return np.asarray(empty | (known & near & (calm < dark + 0.5 * contrast)))
