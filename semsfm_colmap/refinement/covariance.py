"""Covariance of poses and points from the reduced system (Schur complement).

With noise sigma per coordinate and camera Hessian S (points eliminated, priors included), the
camera covariance is the pseudo-inverse of S over the gauge: rotating and shifting the world changes
nothing (6 directions), so S has them as null space N. Any six conditions E that hold the world
still make it invertible, and with N orthonormal

    C = P Z P,    Z = (S + E E^T)^-1,    P = I - N N^T

whatever E is: the covariance in the gauge that makes the total variance of the parameters smallest
(inner constraints, Triggs et al. 2000, section 9). E holds two images, so that S + E E^T has the
band of S; of Z only the blocks of images that share a track are made (`geometry.band`). A point
inherits ``H^-1 + H^-1 E^T C E H^-1``, H its 3 x 3 block and E its coupling to the cameras, and
needs no others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError

from semsfm_colmap.geometry.band import BandFactor, BandMatrix
from semsfm_colmap.geometry.eliminated import (
    Eliminated,
    ReducedSystem,
    linearise,
    precision_of,
)
from semsfm_colmap.geometry.losses import gaussian_constants, weight
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.reduced import PARALLEL_COST, CovisiblePairs, track_batches
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.covariance_kernels import point_covariance
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras, Solution

FULL_SIGMAS = 3.0
"""Residuals up to so many sigma are noise: 98.9 % of a Gaussian in two coordinates."""
BATCH_PAIRS = 10_000
"""Pairs of images whose factors of the gauge are held at a time: some 10 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Covariance:
    """Standard deviations of cameras, covariance of points, in the module's gauge."""

    sigma_rotation_rad: Float
    sigma_translation_px: Float
    sigma_scale: Float
    points: Float
    cameras: CameraCovariance
    """of the camera parameters, in the order of the bundle model"""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraCovariance:
    """C of the module's formula, without its n x n numbers."""

    factor: BandFactor
    """of S + E E^T"""
    gauge: Float
    """(n, 6) N"""

    def variance(self, direction: Float) -> float:
        """Variance ``d^T C d`` of a combination d (n,) of the camera parameters."""
        d = direction - self.gauge @ (self.gauge.T @ direction)
        return max(float(d @ self.factor.solve(d)), 0.0)

    def blocks(self, pairs: CovisiblePairs, param_idx: Int) -> Float:
        """C of each pair of images: (B, p, p), 0 for parameters held fixed."""
        N = self.gauge
        ZN = self.factor.solve(N)
        # P Z P = Z - N (Z N)^T - (Z N) N^T + N (N^T Z N) N^T
        left = np.concatenate([N, N @ (N.T @ ZN) - ZN], axis=1)
        right = np.concatenate([-ZN, N], axis=1)
        fixed = np.zeros((1, left.shape[1]))
        left, right = np.concatenate([left, fixed]), np.concatenate([right, fixed])
        C = self.factor.inverse().get_blocks(pairs.first, pairs.second, param_idx)
        for some in range(0, len(C), BATCH_PAIRS):
            batch = slice(some, some + BATCH_PAIRS)
            rows, cols = param_idx[pairs.first[batch]], param_idx[pairs.second[batch]]
            C[batch] += left[rows] @ right[cols].transpose(0, 2, 1)
        return C


def gauge_directions(model: PoseModel[Any], cameras: OrthographicCameras) -> Float:
    """Orthonormal null space (n, 6) of the reduced system: world rotations and shifts.

    Parameters
    ----------
    cameras : the poses among its parameters

    """
    M = len(cameras)
    N = np.zeros((model.num_params + 1, 6))  # the last row collects index -1
    R = np.asarray(cameras.cam_from_world)
    for k in range(3):
        # exp([R e_k]) R = R exp([e_k]): every camera turns by the same world rotation
        for d in range(3):
            N[model.param_idx[:, d], k] = R[:, d, k]
    P = cameras.projection
    for k in range(3):
        for d in range(2):
            N[model.param_idx[:, 4 + d], 3 + k] = P[:, d, k]
    Q, _ = np.linalg.qr(N[: model.num_params])
    assert len(Q) == model.num_params
    assert M > 0
    return Q


def hold_world(
    S: BandMatrix, N: Float, viewing_direction: Float, pairs: CovisiblePairs, param_idx: Int
) -> None:
    """Add ``E E^T``, six conditions that hold the world still, to the reduced system.

    They hold the parameters of the two images that meet and see the most different views, each in
    units of its own stiffness: ``E = D^1/2 Q``, D their diagonal of S and ``Q R = D^1/2 N``.
    """
    cosine = np.einsum("bi,bi->b", viewing_direction[pairs.first], viewing_direction[pairs.second])
    widest = int(np.argmin(np.abs(cosine)))
    held = np.unique(param_idx[[pairs.first[widest], pairs.second[widest]]])
    held = held[held >= 0]
    stiffness = np.sqrt(S.main_diagonal()[held])[:, None]
    Q, _ = np.linalg.qr(stiffness * N[held])
    E = np.zeros((len(N), 6))
    E[held] = stiffness * Q
    S.add_products(sparse.csr_array(E.T))


def information_weight(state: Eliminated[Any], precision: Float) -> Float:
    """What each observation's information counts, (O,) in 0..1: not the weight of the search.

    The weights of a robust loss scatter with the noise, and their mean is not the information that
    the loss uses of it. Observations within `FULL_SIGMAS` count alike, by the efficiency of the
    loss; those beyond, by how much less the loss trusts them.
    """
    options = state.options
    constants = gaussian_constants(options.loss, options.loss_width)
    s = np.sum(state.residuals**2, axis=1) * precision
    at_bound = weight(options.loss, np.array([FULL_SIGMAS**2]), options.loss_width)[0]
    trust = weight(options.loss, s, options.loss_width) / at_bound
    return np.asarray(constants.efficiency * np.minimum(trust, 1.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """The reduced system with the world held, and its factor."""

    cameras: CameraCovariance
    system: ReducedSystem
    weight: Float
    """(O,) of the information, over the variance"""


def _solve(
    model: PoseModel[Any], state: Eliminated[Any], observations: Observations, sigma_px: float
) -> _Solved | None:
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    precision = precision_of(sigma_px, observations)
    w = information_weight(state, precision)
    system = ReducedSystem.of(model, state.params, observations, pointer)
    S, _ = linearise(model, replace(state, weight=w), observations, pointer, sigma_px, system)
    cameras = model.poses(state.params)
    N = gauge_directions(model, cameras)
    hold_world(S, N, np.asarray(cameras.viewing_direction), system.pairs, model.param_idx)
    try:
        factor = S.factorise()
    except LinAlgError:
        return None
    return _Solved(
        cameras=CameraCovariance(factor=factor, gauge=N), system=system, weight=w * precision
    )


def camera_covariance(
    model: PoseModel[Any], state: Eliminated[Any], observations: Observations, sigma_px: float
) -> CameraCovariance | None:
    """The cameras' part of `estimate_covariance` alone; None where something is not determined."""
    solved = _solve(model, state, observations, sigma_px)
    return None if solved is None else solved.cameras


def estimate_covariance(
    model: PoseModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
) -> Solution[Covariance]:
    """Error bars of a converged bundle adjustment.

    Shared parameters (aspect, skew) are included in the cameras' covariance; their coupling to a
    point is counted once an observation, which is exact.
    """
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    solved = _solve(model, state, observations, sigma_px)
    if solved is None:
        return Solution(
            value=None,
            status="rank_deficient",
            message="some parameters are not determined by the data and priors; "
            "no error bars can be given",
        )
    C, pairs, w = solved.cameras, solved.system.pairs, solved.weight
    blocks = C.blocks(pairs, model.param_idx)
    A = np.ascontiguousarray(model.cameras(state.params)[0])
    points = np.full((observations.num_tracks, 3, 3), np.nan)
    image_idx, track_idx = observations.image_idx, observations.track_idx
    for batch in track_batches(pointer, pairs.order):
        rows = batch.rows
        J = model.jacobian(state.params, state.X, image_idx[rows], track_idx[rows])
        with threads_for(PARALLEL_COST * len(J)):
            point_covariance(
                J, A, w, image_idx, pointer, batch.tracks, batch.begin_row, pairs.lookup, blocks,
                points,
            )  # fmt: skip
    own = blocks[np.diag(pairs.lookup)]
    sigma = np.sqrt(np.maximum(np.einsum("mkk->mk", own), 0.0))
    return Solution(
        value=Covariance(
            sigma_rotation_rad=sigma[:, :3],
            sigma_translation_px=sigma[:, 4:6],
            sigma_scale=sigma[:, 3],
            points=points,
            cameras=C,
        )
    )
