"""The points: how many, seen how often, how sure, and by which frames together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.report.frames import Frames
from semsfm_colmap.types import Int, Reconstruction


@dataclass(frozen=True, kw_only=True)
class PointSigma:
    """Formal standard deviation of a point's position in space, over all points."""

    median_point_sigma_world: float
    p95_point_sigma_world: float


@dataclass(frozen=True, kw_only=True)
class StructureMetrics:
    """Points, observations, and how many images see a point."""

    num_points: int
    num_observations: int
    num_rejected_observations: int
    rejected_fraction: float | None
    mean_track_length: float | None
    median_track_length: float | None
    max_track_length: int | None
    num_points_in_3_or_more_images: int
    track_length_counts: tuple[int, ...]
    """of points seen in 0, 1, 2, ... images"""
    sigma: PointSigma | None
    """None where the points have no covariance"""


@dataclass(frozen=True, kw_only=True, eq=False)
class CoVisibility:
    """Tracks that two frames share."""

    frames: Int
    """(M,) numbers of the registered frames, from 1"""
    num_shared_tracks: Int
    """(M, M); the diagonal counts those of one frame"""


def co_visibility(reconstruction: Reconstruction, frames: Frames) -> CoVisibility:
    """Count the kept tracks that each two registered frames share."""
    from scipy.sparse import csr_array

    obs, kept = reconstruction.observations, reconstruction.inlier
    row, column = frames.rank_of_image()[obs.image_idx[kept]], obs.track_idx[kept]
    shape = (len(frames.registered), len(reconstruction.points))
    seen = csr_array((np.ones(len(row), dtype=np.int64), (row, column)), shape=shape)
    seen.data[:] = 1
    shared = np.asarray((seen @ seen.T).toarray(), dtype=np.int64)
    return CoVisibility(frames=frames.numbers, num_shared_tracks=shared)


def structure_statistics(rec: Reconstruction) -> StructureMetrics:
    """Counts of the points and of what sees them; kept observations only, where not said."""
    length = rec.track_length()
    seen = length[length >= 1]
    return StructureMetrics(
        num_points=len(rec.points),
        num_observations=int(rec.inlier.sum()),
        num_rejected_observations=int((~rec.inlier).sum()),
        rejected_fraction=float((~rec.inlier).mean()) if len(rec.inlier) else None,
        mean_track_length=float(seen.mean()) if len(seen) else None,
        median_track_length=float(np.median(seen)) if len(seen) else None,
        max_track_length=int(seen.max()) if len(seen) else None,
        num_points_in_3_or_more_images=int((length >= 3).sum()),
        track_length_counts=tuple(np.bincount(length).tolist()) if len(length) else (),
        sigma=_point_sigma(rec),
    )


def _point_sigma(rec: Reconstruction) -> PointSigma | None:
    """``sqrt(trace(covariance))`` of a point, where it is finite."""
    if rec.point_covariance is None:
        return None
    sigma = np.sqrt(np.trace(rec.point_covariance, axis1=1, axis2=2))
    sigma = sigma[np.isfinite(sigma)]
    if len(sigma) == 0:
        return None
    return PointSigma(
        median_point_sigma_world=float(np.median(sigma)),
        p95_point_sigma_world=float(np.percentile(sigma, 95)),
    )
