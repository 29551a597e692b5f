"""Tracks that see two points are cut in two, once there are cameras.

One wrong match fuses the tracks of two points that are never seen in one image; triangulation then
keeps the point with more observations and drops all of the other's. What it drops is triangulated
again here: where enough of it agrees on a point of its own it becomes a track of its own, and so on
with what is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.geometry.triangulation import triangulate_tracks
from semsfm_colmap.types import Int, Observations, OrthographicCameras

MAX_POINTS = 4
"""Points looked for in a track."""
THRESHOLD_PX = 4.0
"""Reprojection error up to which an observation agrees with a point: the paper's second round.
Tighter, the cameras of the factorization would cut good tracks; wider, points near each other's
rays would stay fused."""


def split_tracks(
    observations: Observations,
    cameras: OrthographicCameras,
    images: Int,
    *,
    min_length: int,
    trials: int,
    threshold_px: float = THRESHOLD_PX,
    seed: int = 0,
) -> Observations:
    """The same observations, those of a track that agree on a further point in one of their own.

    Parameters
    ----------
    observations : sorted by track
    cameras : of `images` (numbers in `observations`); other images' observations stay as they are
    min_length : fewest observations of a point of its own
    trials : image pairs tried to triangulate a track
    threshold_px : reprojection error up to which an observation agrees with a point

    Returns
    -------
    Observations in the same images, sorted by track, then image; the new tracks come last

    """
    P, t = cameras.projection, np.asarray(cameras.translation_px)
    rows = np.arange(len(observations))
    track_idx = np.array(observations.track_idx)
    num_tracks = observations.num_tracks
    for k in range(MAX_POINTS):
        mask = np.zeros(len(observations), dtype=bool)
        mask[rows] = True
        subset = take_subset(observations, images=images, mask=mask, min_length=min_length)
        local = subset.observations
        if len(local) == 0:
            break
        _, inlier = triangulate_tracks(
            P,
            t,
            local.image_idx,
            track_pointer(local.track_idx, local.num_tracks),
            local.xy,
            threshold_px=threshold_px,
            trials=trials,
            seed=seed,
        )
        count = np.bincount(local.track_idx[inlier], minlength=local.num_tracks)
        found = count >= min_length
        agree = inlier & found[local.track_idx]
        positions = np.flatnonzero(subset.rows)
        if k > 0:
            new = np.cumsum(found) - 1
            track_idx[positions[agree]] = num_tracks + new[local.track_idx[agree]]
            num_tracks += int(found.sum())
        # what no point was found for holds none
        rows = positions[~inlier & found[local.track_idx]]
    if num_tracks == observations.num_tracks:
        return observations
    order = np.lexsort((observations.image_idx, track_idx))
    return replace(observations.select(order), track_idx=track_idx[order], num_tracks=num_tracks)
