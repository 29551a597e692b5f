"""Where each point should be seen: reference views, predicted places and affine warps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.warps import plane_induced_warp
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras


@dataclass(frozen=True, kw_only=True, eq=False)
class References:
    """For each point the view that its patch is taken from."""

    image_idx: Int
    """(N,), -1 without one"""
    xy: Float
    """(N, 2) px"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seeds:
    """Points to look for."""

    points: Float
    normals: Float
    references: References


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Points that one image should see."""

    track_idx: Int
    xy: Float
    """(K, 2) px"""
    warp: Float
    """(K, 2, 2) image px per px of the reference view"""

    def at(self, observations: Observations) -> Predictions:
        """Those of the tracks that an image's observations know, at their measured places."""
        _, mine, theirs = np.intersect1d(
            self.track_idx, observations.track_idx, assume_unique=True, return_indices=True
        )
        return Predictions(
            track_idx=self.track_idx[mine], xy=observations.xy[theirs], warp=self.warp[mine]
        )


def frontal_references(
    cameras: OrthographicCameras, normals: Float, observations: Observations
) -> References:
    """The observation that sees each point's surface most frontally.

    The most frontal view resolves the surface best, and lies in the middle of all others.
    """
    obs = observations
    direction = cameras.viewing_direction[obs.image_idx]
    frontal = -np.einsum("oj,oj->o", direction, normals[obs.track_idx])
    order = np.lexsort((obs.image_idx, -frontal, obs.track_idx))
    tracks, first = np.unique(obs.track_idx[order], return_index=True)
    image_idx = np.full(obs.num_tracks, -1, dtype=np.int64)
    xy = np.full((obs.num_tracks, 2), np.nan)
    image_idx[tracks] = obs.image_idx[order[first]]
    xy[tracks] = obs.xy[order[first]]
    return References(image_idx=image_idx, xy=xy)


def predict(
    image: int,
    cameras: OrthographicCameras,
    points: Float,
    normals: Float,
    references: References,
    image_size_px: tuple[int, int],
    options: GuidedOptions,
) -> Predictions:
    """The points that an image should see, by angle and frame; occlusion is not known yet.

    Parameters
    ----------
    points, normals : (N, 3); normals toward the viewer
    image_size_px : width, height

    """
    direction = cameras.viewing_direction
    has = references.image_idx >= 0
    d_ref = direction[np.maximum(references.image_idx, 0)]
    xy = cameras.project(points, np.full(len(points), image))
    width, height = image_size_px
    seen = (
        has
        & (-normals @ direction[image] > np.cos(np.deg2rad(options.max_view_angle_deg)))
        & (d_ref @ direction[image] > np.cos(np.deg2rad(options.max_baseline_deg)))
        & (-np.einsum("nj,nj->n", normals, d_ref) > np.cos(np.deg2rad(80.0)))
        & (xy[:, 0] > 0)
        & (xy[:, 1] > 0)
        & (xy[:, 0] < width)
        & (xy[:, 1] < height)
        & (references.image_idx != image)
    )
    track = np.flatnonzero(seen)
    A = cameras.projection
    warp = plane_induced_warp(
        A[references.image_idx[track]],
        np.broadcast_to(A[image], (len(track), 2, 3)),
        normals[track],
    )
    return Predictions(track_idx=track, xy=xy[track], warp=warp)
