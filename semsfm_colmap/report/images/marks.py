"""What is drawn over the images: keypoints by fate, residual vectors, trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.report.frames import Frames
from semsfm_colmap.report.images.fates import Fate, Keypoints
from semsfm_colmap.report.images.packed import (
    base64_of,
    packed_ellipses,
    packed_places,
    packed_residuals,
)
from semsfm_colmap.report.thinning import even_subset
from semsfm_colmap.types import Float, Int, Reconstruction

SizePx = tuple[int, int]


def even_by_fate(fate: Int, max_num: int) -> Int:
    """Increasing indices of at most so many keypoints, each fate with its share."""
    if len(fate) <= max_num:
        return np.arange(len(fate))
    by_fate = np.argsort(fate, kind="stable")
    return np.sort(by_fate[even_subset(len(fate), max_num)])


def packed_keypoints(keypoints: Keypoints, size_px: SizePx, max_num: int) -> dict[str, Any]:
    """Keypoints as the script draws them, with the counts of all of them."""
    rows = even_by_fate(keypoints.fate, max_num)
    return {
        "xy": packed_places(keypoints.xy[rows], size_px),
        "shape": packed_ellipses(keypoints.shape[rows]),
        "fate": base64_of(keypoints.fate[rows], "u1"),
        "num": len(rows),
        "total": len(keypoints.fate),
        "counts": [keypoints.counts()[fate] for fate in Fate],
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualVectors:
    """Kept observations of one image and how far the model's points are from them."""

    xy: Float
    """(P, 2) px, measured"""
    residual: Float
    """(P, 2) px, predicted minus measured"""
    total: int
    """how many there are in all"""


def residual_vectors(
    reconstruction: Reconstruction, residual: Float, image_idx: int, max_num: int
) -> ResidualVectors:
    """The residuals of an image's kept observations, an even selection of them."""
    obs = reconstruction.observations
    rows = np.flatnonzero((obs.image_idx == image_idx) & reconstruction.inlier)
    some = rows[even_subset(len(rows), max_num)]
    return ResidualVectors(xy=obs.xy[some], residual=residual[some], total=len(rows))


def packed_residual_vectors(vectors: ResidualVectors, size_px: SizePx) -> dict[str, Any]:
    """Residual vectors as the script draws them."""
    return {
        "xy": packed_places(vectors.xy, size_px),
        "d": packed_residuals(vectors.residual),
        "num": len(vectors.xy),
        "total": vectors.total,
    }


def packed_trajectories(
    reconstruction: Reconstruction, frames: Frames, sizes_px: Sequence[SizePx], max_places: int
) -> dict[str, Any]:
    """The longest tracks, evenly chosen among equals: their places frame by frame.

    Parameters
    ----------
    sizes_px : of all frames

    """
    rec = reconstruction
    length = rec.track_length()
    # of tracks of one length an even choice, long ones first: they show the motion
    tie = np.arange(len(length)) * 0.6180339887498949 % 1.0
    order = np.lexsort((tie, -length))
    order = order[length[order] >= 2]
    chosen = order[np.cumsum(length[order]) <= max_places]
    rank = np.full(len(length), -1)
    rank[chosen] = np.arange(len(chosen))
    frame_of = np.zeros(rec.num_images, dtype=np.int64)
    frame_of[frames.image_idx] = frames.registered
    obs = rec.observations
    rows = np.flatnonzero(rec.inlier & (rank[obs.track_idx] >= 0))
    frame = frame_of[obs.image_idx[rows]]
    rows = rows[np.lexsort((frame, rank[obs.track_idx[rows]]))]
    frame = frame_of[obs.image_idx[rows]]
    size = np.array(sizes_px, dtype=np.float64).reshape(-1, 2)[frame]
    return {
        "lengths": base64_of(length[chosen], "u2"),
        "frame": base64_of(frame, "u2"),
        "xy": packed_places(obs.xy[rows] / size, (1, 1)),
        "num": len(chosen),
        "total": int(np.sum(length >= 2)),
    }
