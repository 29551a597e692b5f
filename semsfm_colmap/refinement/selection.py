"""Which observations support a point, and which images keep enough of them."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.triangulation import (
    drop_deviating,
    triangulate_tracks,
    triangulation_angle,
)
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.types import Bool, Int, Observations, OrthographicCameras


def select_inliers(
    cameras: OrthographicCameras,
    observations: Observations,
    threshold_px: float,
    options: RefinementOptions,
    seed: int,
) -> Bool:
    """Observations that support a well-conditioned point within the threshold."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    _, inlier = triangulate_tracks(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        threshold_px=threshold_px,
        trials=options.ransac_trials,
        seed=seed,
    )
    inlier = drop_deviating(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        inlier,
        threshold_px=threshold_px,
        min_length=options.min_track_length,
    )
    length = np.bincount(obs.track_idx[inlier], minlength=obs.num_tracks)
    angle = triangulation_angle(cameras.viewing_direction, obs.image_idx, pointer, inlier)
    good = (length >= options.min_track_length) & (
        angle >= np.deg2rad(options.min_triangulation_angle_deg)
    )
    return inlier & good[obs.track_idx]


def registered_images(
    inlier: Bool,
    observations: Observations,
    options: RefinementOptions,
    *,
    min_inlier_share: float = 0.0,
) -> Int:
    """Images with enough inlier observations, in number and among those of tracks with a point."""
    obs = observations
    count = np.bincount(obs.image_idx[inlier], minlength=obs.num_images)
    has_point = np.bincount(obs.track_idx[inlier], minlength=obs.num_tracks) > 0
    total = np.bincount(obs.image_idx[has_point[obs.track_idx]], minlength=obs.num_images)
    return np.flatnonzero(
        (count >= options.min_image_observations) & (count >= min_inlier_share * total)
    )
