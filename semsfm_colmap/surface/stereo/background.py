"""Which pixels of an image show no specimen, although a stereo window beside it finds a depth.

Windows that straddle a silhouette match on the bright edge alone and give the dark pixels next to
it the edge's depth: a halo of the window's radius around everything. Where a large region finds no
correlation at any depth it is background, and so is one that finds little and is darker or brighter
than the specimen beside it: a specimen of little texture correlates little too, but is as grey as
the rest of it. A pixel near the background whose grey lies on the background's side of half-way
between the local background and the local specimen belongs to it. An image that the specimen fills
has no such region and loses nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from semsfm_colmap.types import Array, Bool

_MIN_REGION = 0.002
"""Share of the image that an uncorrelated region must cover to count as background."""
_MIN_CONTRAST_SIGMA = 4.0
"""Specimen and background must differ by this many deviations of the noise to be told apart."""
_UNCORRELATED = 0.35
"""Mean of the best correlation over a window: noise that compression has shaped reaches 0.35,
little texture under much noise 0.3 to 0.6, texture 0.6 and more."""
_NOTHING = 0.2
"""Below it there is no texture at all: plain noise reaches 0.15, little texture 0.3 and more."""
_MIN_SEPARATION = 0.9
"""Share of pairs, one pixel of each, in which the specimen is the brighter one (or the darker)."""
_REACH = 4
"""How far beside a region the specimen is looked at, in its radii."""
_CALM_PX = 1.5
"""Greys are compared after smoothing by this, against noise."""


def uncorrelated_region(correlation: Array, grey: Array, radius: int) -> Bool:
    """Large regions of background: (H, W) bool.

    Parameters
    ----------
    correlation : (H, W) the best one over all depths
    grey : (H, W) float32
    radius : of the window that it is averaged over

    """
    import cv2

    size = 2 * radius + 1
    mean = cv2.blur(correlation, (size, size))
    out = np.zeros(mean.shape, dtype=bool)
    for region in _large(mean < _NOTHING):
        out |= region
    calm = cv2.GaussianBlur(grey, (0, 0), _CALM_PX)
    # beyond the halo
    specimen = cv2.erode((mean >= _UNCORRELATED).astype(np.uint8), np.ones((size, size))) > 0
    beside = np.ones((2 * _REACH * radius + 1,) * 2, np.uint8)
    for region in _large(mean < _UNCORRELATED):
        near = specimen & (cv2.dilate(region.astype(np.uint8), beside) > 0)
        if _separation(calm[region], calm[near]) >= _MIN_SEPARATION:
            out |= region
    return out


def _large(mask: Bool) -> Iterator[Bool]:
    """The connected parts of a mask that cover enough of the image, one by one."""
    import cv2

    count, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] >= _MIN_REGION * mask.size:
            yield label == k


def _separation(region: Array, specimen: Array) -> float:
    """In what share of pairs of values one is above the other, whichever comes more often."""
    if len(specimen) == 0:
        return 1.0  # nothing but background is near
    above = np.searchsorted(np.sort(region), specimen).mean() / len(region)
    return float(max(above, 1.0 - above))


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
