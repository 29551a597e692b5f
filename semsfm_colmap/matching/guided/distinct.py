"""Tracks that show the same spot: found by their places, the better one kept."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Bool, Float, Int, Observations

MIN_SHARED_IMAGES = 2
"""Two tracks must lie on one another in so many images: in one image they may merely cross."""


def distinct_tracks(observations: Observations, min_separation_px: float) -> Bool:
    """Which tracks to keep (N,): of two that lie on one another in two images the longer.

    Taken from the longest track to the shortest; a track is dropped when a kept one covers it.
    """
    from scipy.spatial import cKDTree

    obs = observations
    num = obs.num_tracks
    pairs = []
    for i in np.unique(obs.image_idx):
        rows = np.flatnonzero(obs.image_idx == i)
        close = cKDTree(obs.xy[rows]).query_pairs(min_separation_px, output_type="ndarray")
        tracks = np.sort(obs.track_idx[rows[close]], axis=1)
        pairs.append(tracks[:, 0] * num + tracks[:, 1])
    code, count = np.unique(np.concatenate(pairs), return_counts=True)
    code = code[count >= MIN_SHARED_IMAGES]
    return _longest_first(code // num, code % num, np.bincount(obs.track_idx, minlength=num))


def distinct_points(points: Float, length: Int, radius: float) -> Bool:
    """Which points (N, 3) to keep (N,): of two nearer than `radius` that of the longer track.

    Before every point is looked for in every image: the turns of a helix each bring their own track
    of the same spot, and the work would grow with the square of the turns.
    """
    from scipy.spatial import cKDTree

    close = np.sort(cKDTree(points).query_pairs(radius, output_type="ndarray"), axis=1)
    order = np.lexsort((close[:, 1], close[:, 0]))
    return _longest_first(close[order, 0], close[order, 1], length)


def _longest_first(first: Int, second: Int, length: Int) -> Bool:
    """Of pairs that show one spot the longer stays, from the longest to the shortest."""
    num = len(length)
    # rank 0 is the longest track; ties go to the smaller number
    rank = np.empty(num, dtype=np.int64)
    rank[np.lexsort((np.arange(num), -length))] = np.arange(num)
    better = np.where(rank[first] < rank[second], first, second)
    worse = np.where(rank[first] < rank[second], second, first)
    keep = np.ones(num, dtype=bool)
    for k in np.argsort(rank[better], kind="stable"):
        if keep[better[k]]:
            keep[worse[k]] = False
    return keep
