"""Linear structure: with the cameras known, each point is a small linear least-squares problem.

For track j with cameras ``xy = A_i X + t_i`` and weights w, the point that minimises
``sum_i w_i |A_i X + t_i - xy_i|^2`` solves ``(sum w A^T A) X = sum w A^T (xy - t)``, 3 x 3.
Observations must be sorted by track; ``track_pointer[j] : track_pointer[j + 1]`` are those of j.
"""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.losses import LOSS_NUMBER, LossName, loss_of, weight_of
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.types import Array, Float, Int

MIN_RELATIVE_DETERMINANT = 1e-12
"""det(H) / (tr(H) / 3)^3 below which a track does not fix its point: rays parallel to 1e-6 rad."""
FIT_CHUNKS = 64
"""Partial sums of the cost, whatever the number of threads."""


def track_pointer(track_idx: Array, num_tracks: int) -> Int:
    """Where each track begins among observations sorted by track: (O,) -> (N + 1,)."""
    counts = np.bincount(track_idx, minlength=num_tracks)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


@numba.njit(cache=True)
def invert_symmetric(H, out):  # type: ignore[no-untyped-def]
    """Inverse of a positive definite 3 x 3 matrix by cofactors; False when it is singular."""
    a, b, c = H[0, 0], H[0, 1], H[0, 2]
    d, e, f = H[1, 1], H[1, 2], H[2, 2]
    c00 = d * f - e * e
    c01 = c * e - b * f
    c02 = b * e - c * d
    det = a * c00 + b * c01 + c * c02
    mean = (a + d + f) / 3.0
    if not det > MIN_RELATIVE_DETERMINANT * mean * mean * mean:
        return False
    k = 1.0 / det
    out[0, 0] = c00 * k
    out[0, 1] = out[1, 0] = c01 * k
    out[0, 2] = out[2, 0] = c02 * k
    out[1, 1] = (a * f - c * c) * k
    out[1, 2] = out[2, 1] = (b * c - a * e) * k
    out[2, 2] = (a * d - b * b) * k
    return True


@numba.njit(cache=True)
def add_observation(H, b, P, du, dv, w):  # type: ignore[no-untyped-def]
    """Add one observation's ``w P^T P`` to H and ``w P^T [du, dv]`` to b."""
    for k in range(3):
        b[k] += w * (P[0, k] * du + P[1, k] * dv)
        for m in range(3):
            H[k, m] += w * (P[0, k] * P[0, m] + P[1, k] * P[1, m])


@numba.njit(cache=True, parallel=True)
def _solve_points(A, t, image_idx, pointer, xy, weight, X):  # type: ignore[no-untyped-def]
    for j in numba.prange(len(pointer) - 1):
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        for o in range(pointer[j], pointer[j + 1]):
            i = image_idx[o]
            add_observation(H, b, A[i], xy[o, 0] - t[i, 0], xy[o, 1] - t[i, 1], weight[o])
        if invert_symmetric(H, inverse):
            for k in range(3):
                X[j, k] = inverse[k, 0] * b[0] + inverse[k, 1] * b[1] + inverse[k, 2] * b[2]
        else:
            for k in range(3):
                X[j, k] = np.nan


def solve_points(
    A: Float, t: Float, image_idx: Int, pointer: Int, xy: Float, weight: Float
) -> Float:
    """The best point of every track.

    Parameters
    ----------
    A, t : (M, 2, 3), (M, 2), the cameras
    image_idx, xy, weight : (O,), (O, 2), (O,), sorted by track
    pointer : (N + 1,), see `track_pointer`

    Returns
    -------
    (N, 3), nan where the rays of a track do not fix a point

    """
    X = np.empty((len(pointer) - 1, 3))
    with threads_for(len(image_idx)):
        _solve_points(A, t, image_idx, pointer, xy, weight, X)
    return X


@numba.njit(cache=True, parallel=True)
def _residuals(A, t, X, image_idx, track_idx, xy, r):  # type: ignore[no-untyped-def]
    for o in numba.prange(len(image_idx)):
        i, j = image_idx[o], track_idx[o]
        for d in range(2):
            r[o, d] = (A[i, d, 0] * X[j, 0] + A[i, d, 1] * X[j, 1] + A[i, d, 2] * X[j, 2]) + (
                t[i, d] - xy[o, d]
            )


def residuals(A: Float, t: Float, X: Float, image_idx: Int, track_idx: Int, xy: Float) -> Float:
    """``A_i X_j + t_i - xy``: (O, 2) px."""
    r = np.empty((len(image_idx), 2))
    with threads_for(len(image_idx)):
        _residuals(A, t, X, image_idx, track_idx, xy, r)
    return r


@numba.njit(cache=True, parallel=True)
def _fit_points(  # type: ignore[no-untyped-def]
    A, t, image_idx, pointer, xy, precision, number, w2, rounds, chunk, X, r, w, cost
):
    for c in numba.prange(len(chunk) - 1):
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        x = np.zeros(3)
        for j in range(chunk[c], chunk[c + 1]):
            begin, end = pointer[j], pointer[j + 1]
            for _ in range(rounds):
                H[:] = 0.0
                b[:] = 0.0
                for o in range(begin, end):
                    i = image_idx[o]
                    du, dv = xy[o, 0] - t[i, 0], xy[o, 1] - t[i, 1]
                    add_observation(H, b, A[i], du, dv, w[o] * precision[o])
                x[:] = 0.0
                if invert_symmetric(H, inverse):
                    for k in range(3):
                        x[k] = inverse[k, 0] * b[0] + inverse[k, 1] * b[1] + inverse[k, 2] * b[2]
                for o in range(begin, end):
                    i = image_idx[o]
                    for d in range(2):
                        r[o, d] = (A[i, d, 0] * x[0] + A[i, d, 1] * x[1] + A[i, d, 2] * x[2]) + (
                            t[i, d] - xy[o, d]
                        )
                    s = (r[o, 0] * r[o, 0] + r[o, 1] * r[o, 1]) * precision[o]
                    w[o] = weight_of(number, s, w2)
            for k in range(3):
                X[j, k] = x[k]
            for o in range(begin, end):
                s = (r[o, 0] * r[o, 0] + r[o, 1] * r[o, 1]) * precision[o]
                cost[c] += loss_of(number, s, w2)


def fit_points(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    precision: Float,
    start_weight: Float,
    *,
    loss: LossName,
    loss_width: float,
    rounds: int,
) -> tuple[Float, Float, Float, float]:
    """Points, residuals, robust weights and the sum of the loss in one pass over the tracks.

    Each round solves for the point with the weights at hand and reweights its observations; one
    round is all that the squared loss needs.

    Parameters
    ----------
    precision : (O,) one over the variance of a coordinate, px^-2
    start_weight : (O,) weights of the first round

    Returns
    -------
    X : (N, 3), zero where the rays of a track do not fix a point
    r : (O, 2) px
    w : (O,) weights at the final residuals
    cost : sum of the loss

    """
    num_tracks = len(pointer) - 1
    X, r = np.empty((num_tracks, 3)), np.empty((len(image_idx), 2))
    w = np.array(start_weight, dtype=np.float64)
    chunk = np.linspace(0, num_tracks, FIT_CHUNKS + 1).astype(np.int64)
    cost = np.zeros(FIT_CHUNKS)
    number, w2 = LOSS_NUMBER[loss], loss_width * loss_width
    with threads_for(rounds * len(image_idx)):
        _fit_points(
            A, t, image_idx, pointer, xy, precision, number, w2, rounds, chunk, X, r, w, cost
        )
    return X, r, w, float(cost.sum())
