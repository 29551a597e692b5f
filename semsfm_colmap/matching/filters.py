"""Heuristic filters on matches: the paper's distance filter, and what does not move."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Bool, Float

RING_FACTOR = 4.0
"""The ring around the static disc reaches to so many times its radius."""
MIN_STATIC_MATCHES = 10
"""Fewer static matches than this are not told from chance."""


def distance_filter(displacement: Float, sigmas: float) -> Bool:
    """Keep matches whose displacement length is within `sigmas` standard deviations.

    A false match can satisfy the epipolar constraint, but it often moves much further than its
    neighbours [paper, section "Affine feature tracking"]. Lengths are compared with their median;
    the standard deviation is that of all lengths.

    Parameters
    ----------
    displacement : (L, 2) px

    """
    if sigmas <= 0.0 or len(displacement) < 3:
        return np.ones(len(displacement), dtype=bool)
    length = np.linalg.norm(displacement - np.median(displacement, axis=0), axis=1)
    return np.asarray(length <= np.median(length) + sigmas * max(float(np.std(length)), 0.5))


def static_matches(displacement: Float, radius_px: float, excess: float) -> Bool:
    """Matches that stand still while others move: databar, detector dust, background.

    A specimen that turns also has points that hardly move, those on its axis, but its displacements
    pass through zero smoothly, and they do so along one direction: parallel projection moves every
    point along its epipolar line. Static things pile up at zero: the matches within `radius_px` of
    zero are called static when, by length of displacement, they are `excess` times denser than
    those in the ring around.

    Parameters
    ----------
    displacement : (L, 2) px

    Returns
    -------
    (L,) True where static

    """
    length = np.linalg.norm(displacement, axis=1)
    inner = length < radius_px
    if excess <= 0.0 or np.sum(inner) < MIN_STATIC_MATCHES:
        return np.zeros(len(length), dtype=bool)
    if np.sum(inner) > 0.8 * len(length):
        # everything stands still: that is a repeated view, not a background
        return np.zeros(len(length), dtype=bool)
    ring = np.sum((length >= radius_px) & (length < RING_FACTOR * radius_px))
    expected = ring / (RING_FACTOR - 1.0)
    if np.sum(inner) < excess * (expected + 1.0):
        return np.zeros(len(length), dtype=bool)
    return np.asarray(inner)
