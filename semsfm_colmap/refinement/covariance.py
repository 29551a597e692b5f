"""Covariance of poses and points from the reduced system (Schur complement).

With noise sigma per coordinate and camera Hessian S (points eliminated, priors included), the
camera covariance is the pseudo-inverse of S over the gauge: rotating and shifting the world changes
nothing (6 directions), so S has them as null space N and

    C = (S + N N^T)^-1 - N N^T    (N orthonormal)

is the covariance in the gauge that makes the total variance of the parameters smallest (inner
constraints, Triggs et al. 2000, section 9). A point inherits ``H^-1 + H^-1 E^T C E H^-1``, H its
3 x 3 block and E its coupling to the cameras.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, cho_factor, lapack

from semsfm_colmap.geometry.eliminated import CameraModel, Eliminated, linearise, precision_of
from semsfm_colmap.geometry.losses import gaussian_constants, weight
from semsfm_colmap.geometry.points import add_observation, invert_symmetric, track_pointer
from semsfm_colmap.geometry.reduced import PARALLEL_COST, covisible_pairs, track_batches
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.types import Array, Float, Observations, OrthographicCameras, Solution

FULL_SIGMAS = 3.0
"""Residuals up to so many sigma are noise: 98.9 % of a Gaussian in two coordinates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Covariance:
    """Standard deviations of cameras, covariance of points, in the module's gauge."""

    sigma_rotation_rad: Float
    sigma_translation_px: Float
    sigma_scale: Float
    points: Float
    cameras: Float
    """(n, n) full covariance of the camera parameters, in the order of the bundle model"""


def gauge_directions(model: CameraModel[Any], cameras: OrthographicCameras) -> Float:
    """Orthonormal null space (n, 6) of the reduced system: world rotations and shifts.

    Parameters
    ----------
    model : its first parameters are those of `BundleModel`; any others do not matter at zero

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


@numba.njit(cache=True, parallel=True)
def _point_covariance(  # type: ignore[no-untyped-def]
    J, A, w, image_idx, pointer, tracks, begin_row, param_idx, C, out
):
    p = J.shape[2]
    for t in numba.prange(len(tracks)):
        j = tracks[t]
        begin, end = pointer[j], pointer[j + 1]
        # where the track begins in J
        shift = begin_row[t] - begin
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        for o in range(begin, end):
            add_observation(H, b, A[image_idx[o]], 0.0, 0.0, w[o])
        if not invert_symmetric(H, inverse):
            out[j] = np.nan
            continue
        E = np.zeros((end - begin, p, 3))
        for o in range(begin, end):
            i = image_idx[o]
            for k in range(p):
                for m in range(3):
                    E[o - begin, k, m] = w[o] * (
                        J[o + shift, 0, k] * A[i, 0, m] + J[o + shift, 1, k] * A[i, 1, m]
                    )
        # B = E^T C E, summed over all pairs of observations of the track
        B = np.zeros((3, 3))
        CE = np.zeros((p, 3))
        for o in range(begin, end):
            for q in range(begin, o + 1):
                CE[:] = 0.0
                for m in range(p):
                    gm = param_idx[image_idx[q], m]
                    if gm < 0:
                        continue
                    for k in range(p):
                        gk = param_idx[image_idx[o], k]
                        if gk >= 0:
                            for y in range(3):
                                CE[k, y] += C[gk, gm] * E[q - begin, m, y]
                for x in range(3):
                    for y in range(3):
                        value = 0.0
                        for k in range(p):
                            value += E[o - begin, k, x] * CE[k, y]
                        B[x, y] += value
                        # the pair the other way round is the transpose
                        if q < o:
                            B[y, x] += value
        out[j] = inverse + inverse @ B @ inverse


@numba.njit(cache=True)
def _mirror(a):  # type: ignore[no-untyped-def]
    for i in range(len(a)):
        for j in range(i):
            a[j, i] = a[i, j]


def inverse_from_factor(lower: Float) -> Float:
    """The inverse of a positive definite matrix from its Cholesky factor (lower triangle).

    In place where LAPACK can: with a thousand images a matrix has 300 MB.
    """
    inverse, info = lapack.dpotri(lower, lower=1, overwrite_c=1)
    assert info == 0
    _mirror(inverse)
    return np.asarray(inverse)


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


def estimate_covariance(
    model: CameraModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
) -> Solution[Covariance]:
    """Error bars of a converged bundle adjustment.

    Parameters
    ----------
    model : `BundleModel`, or with cameras as the first of its parameters `ScanDriftModel`

    Shared parameters (aspect, skew) are included in the cameras' covariance; their coupling to a
    point is counted once an observation, which is exact.
    """
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    precision = precision_of(sigma_px, observations)
    w = information_weight(state, precision)
    pairs = covisible_pairs(observations.image_idx, pointer, observations.num_images)
    H, _ = linearise(model, replace(state, weight=w), observations, pointer, sigma_px, pairs)
    w = w * precision
    S = H.toarray() if sparse.issparse(H) else np.asarray(H)
    cameras = state.params if isinstance(model, BundleModel) else state.params[0]
    N = gauge_directions(model, cameras)
    # the gauge directions get the stiffness of a typical parameter, for conditioning
    stiffness = float(np.median(np.diag(S)))
    gauge = N @ N.T
    try:
        factor = cho_factor(S + stiffness * gauge, lower=True, overwrite_a=True)
    except LinAlgError:
        return Solution(
            value=None,
            status="rank_deficient",
            message="some parameters are not determined by the data and priors; "
            "no error bars can be given",
        )
    C = inverse_from_factor(factor[0])
    gauge /= stiffness
    C -= gauge
    A = np.ascontiguousarray(model.cameras(state.params)[0])
    points = np.full((observations.num_tracks, 3, 3), np.nan)
    image_idx, track_idx = observations.image_idx, observations.track_idx
    for batch in track_batches(pointer, pairs.order):
        rows = batch.rows
        J = model.jacobian(state.params, state.X, image_idx[rows], track_idx[rows])
        with threads_for(PARALLEL_COST * len(J)):
            _point_covariance(
                J, A, w, image_idx, pointer, batch.tracks, batch.begin_row, model.param_idx, C,
                points,
            )  # fmt: skip
    variance = np.concatenate([np.maximum(np.diag(C), 0.0), [0.0]])
    sigma: Array = np.sqrt(variance[model.param_idx])
    return Solution(
        value=Covariance(
            sigma_rotation_rad=sigma[:, :3],
            sigma_translation_px=sigma[:, 4:6],
            sigma_scale=sigma[:, 3],
            points=points,
            cameras=C,
        )
    )
