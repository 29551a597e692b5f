"""Error bars that a series will have, from the covariance of the real estimator.

The bundle adjustment of magnifications, poses and scan drift (`refinement.scan_drift`) is
linearised at the geometry planned. Its cameras have the covariance C, and the points follow them,
``dX = L dc``. Only what a rigid motion of the world cannot explain is an error: with G (3 N, 6) the
motions of the points and ``P = I - G G^+``, the depth of point j, along its normal n_j, has

    var_j = n_j^T H_j^-1 n_j  +  b_j^T C b_j,    b_j = n_j^T (P L)_j,

H_j the information of its own rays. The first part is noise of the point alone, the second one is
common to neighbours: mostly depths stretched by angles that are too large or too small. A rotation
w_i (on the left, in the camera's frame) is compensated for the same motion, ``w_i + R_i dtheta``.
The six degrees of freedom that the points' own noise takes out of theirs are left in: 6 of 3 N.

Each point may stand for k of the specimen: the cameras then know k times as much, ``C(sigma^2/k)``,
beside priors that stay as they are.

Shading displaces features by more than noise, and more images do not average it out: what is left
of the drag and the other fields of docs/truth.md move the cameras by modes m, and a depth by
``b_j^T m``. The relief under a point's window (`uncertainty.RELIEF_PX`) comes on top.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated, SolverOptions, evaluate
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.rotations import skew_matrix
from semsfm_colmap.planning.options import NoiseOptions
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.bundle import plain_model
from semsfm_colmap.refinement.covariance import CameraCovariance, camera_covariance
from semsfm_colmap.refinement.drag import (
    DRAG_SIGMA_PX,
    doubt_px,
    drag_field,
    misfit_px,
)
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.refinement.shading import SHADING_SIGMA_PX, shading_fields
from semsfm_colmap.refinement.uncertainty import apply_covariance, field_modes, point_modes
from semsfm_colmap.types import Float, Observations, OrthographicCameras

WORST_SHARE = 0.95
"""The worst depth is that of the worst twentieth: a single point may be seen by chance only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """Who sees what: the series whose error bars are wanted."""

    cameras: OrthographicCameras
    """about 1 px a unit"""
    points: Float
    """(N, 3) px"""
    normals: Float
    """(N, 3) outward, of unit length"""
    observations: Observations
    """sorted by track; their places matter to nothing but the noise of a project"""
    height_px: float
    """of a frame"""
    points_per_point: float = 1.0
    """k: how many points of the specimen each one stands for"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Standard deviations of depths along the normals and of rotations, px and rad."""

    own_px: Float
    """(N,) by the noise of the point's own matches"""
    cameras_px: Float
    """(N,) by what the noise of all matches does to the cameras"""
    shading_px: Float
    """(N,) by what shading does to the cameras: more images do not lower it"""
    sigma_rotation_rad: Float
    """(M, 3) by noise, about the camera's x, y, z"""

    @property
    def depth_px(self) -> Float:
        """(N,) by noise"""
        return np.hypot(self.own_px, self.cameras_px)

    @property
    def median_px(self) -> float:
        """Of the depths, by noise."""
        return float(np.median(self.depth_px))

    @property
    def mean_px(self) -> float:
        """Of the depths, by noise."""
        return float(np.mean(self.depth_px))

    @property
    def worst_px(self) -> float:
        """Exceeded by a twentieth of the depths."""
        return float(np.quantile(self.depth_px, WORST_SHARE))

    @property
    def rotation_deg(self) -> float:
        """Median over images and axes."""
        return float(np.rad2deg(np.median(self.sigma_rotation_rad)))


def predict(geometry: Geometry, options: NoiseOptions) -> Prediction | None:
    """Error bars of a series of this geometry; None where something is not determined.

    Parameters
    ----------
    geometry : every point seen three times at least, from directions that differ

    """
    obs, cameras, X = geometry.observations, geometry.cameras, geometry.points
    sigma_px = options.noise_px / np.sqrt(geometry.points_per_point)
    model, params = _model(geometry, options)
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    state: Eliminated[Any] = evaluate(
        model, params, obs, pointer, sigma_px, SolverOptions(), np.ones(len(obs))
    )
    C = camera_covariance(model, state, obs, sigma_px)
    if C is None:
        return None
    n = model.num_params
    follow = point_modes(model, state, obs, sigma_px, np.eye(n)).reshape(-1, n)
    G = rigid_motions(X)
    motion = np.linalg.pinv(G) @ follow
    moved = (follow - G @ motion).reshape(len(X), 3, n)
    b = np.einsum("nk,nkc->nc", geometry.normals, moved)
    # image, axis, parameter
    w = np.einsum("mij,jc->mic", cameras.cam_from_world, motion[:3])
    image, axis = np.indices((len(cameras), 3))
    w[image, axis, model.param_idx[:, :3]] += 1.0
    shading = b @ _shading_modes(geometry, model, state, sigma_px, C)
    own = own_covariance(cameras, obs, options.noise_px)
    return Prediction(
        own_px=np.sqrt(np.einsum("ni,nij,nj->n", geometry.normals, own, geometry.normals)),
        cameras_px=_sigma(C, b),
        shading_px=np.linalg.norm(shading, axis=1),
        sigma_rotation_rad=_sigma(C, w.reshape(-1, n)).reshape(-1, 3),
    )


def own_covariance(
    cameras: OrthographicCameras, observations: Observations, sigma_px: float
) -> Float:
    """``H^-1 = sigma^2 (sum A^T A)^-1`` of each track with the cameras known: (N, 3, 3)."""
    obs = observations
    A = cameras.projection
    H = np.zeros((obs.num_tracks, 3, 3))
    AtA = A.mT @ A
    np.add.at(H, obs.track_idx, AtA[obs.image_idx] * obs.precision[:, None, None])
    return np.asarray(sigma_px**2 * np.linalg.inv(H))


def rigid_motions(points: Float) -> Float:
    """G: how points (N, 3) move with small rotations about their centroid and shifts, (3 N, 6)."""
    turn = -skew_matrix(points - points.mean(axis=0))
    shift = np.broadcast_to(np.eye(3), turn.shape)
    return np.concatenate([turn, shift], axis=2).reshape(-1, 6)


def _sigma(C: CameraCovariance, rows: Float) -> Float:
    """``sqrt(b^T C b)`` of each row b."""
    variance = np.einsum("bc,cb->b", rows, apply_covariance(C, rows.T))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _model(geometry: Geometry, options: NoiseOptions) -> tuple[PoseModel[Any], Any]:
    """The camera model that the mapping stage adjusts, and its parameters."""
    M = len(geometry.cameras)
    base = plain_model(M, options.scale_sigma)
    if options.drift_sigma_px <= 0.0:
        return base, geometry.cameras
    height = np.full(M, geometry.height_px)
    model = ScanDriftModel.build(base, options.drift_sigma_px, height)
    return model, (geometry.cameras, np.zeros((M, 2)))


def _shading_modes(
    geometry: Geometry,
    model: PoseModel[Any],
    state: Eliminated[Any],
    sigma_px: float,
    C: CameraCovariance,
) -> Float:
    """Modes (n, 10) of the cameras: what is left of the drag, and the other fields."""
    obs, normals = geometry.observations, geometry.normals
    R = np.asarray(geometry.cameras.cam_from_world)
    misfit = misfit_px(float(np.rad2deg(total_rotation(R))))
    trust = DRAG_SIGMA_PX**2 / (DRAG_SIGMA_PX**2 + misfit**2)
    left_px = np.sqrt(trust * misfit**2 + doubt_px(DRAG_SIGMA_PX) ** 2)
    drag = left_px * drag_field(R, normals, obs.image_idx, obs.track_idx)[:, :, None]
    other = SHADING_SIGMA_PX * shading_fields(R, normals, obs.image_idx, obs.track_idx)
    fields = np.concatenate([drag, other], axis=2)
    return field_modes(model, state, obs, sigma_px, C, fields)
