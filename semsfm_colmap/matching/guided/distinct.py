"""Tracks that show the same spot: found by their places, the better one kept."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Bool, Observations

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
    first, second = code // num, code % num
    length = np.bincount(obs.track_idx, minlength=num)
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
