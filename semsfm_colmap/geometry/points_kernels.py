"""Compiled least squares of the points, one track after the other (see `points`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.losses_kernels import loss_of, weight_of
from semsfm_colmap.types import Float, Int

MIN_RELATIVE_DETERMINANT = 1e-12
"""det(H) / (tr(H) / 3)^3 below which a track does not fix its point: rays parallel to 1e-6 rad."""


@numba.njit(cache=True)
def invert_symmetric(H: Float, out: Float) -> bool:
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
def add_observation(H: Float, b: Float, P: Float, du: float, dv: float, w: float) -> None:
    """Add one observation's ``w P^T P`` to H and ``w P^T [du, dv]`` to b."""
    for k in range(3):
        b[k] += w * (P[0, k] * du + P[1, k] * dv)
        for m in range(3):
            H[k, m] += w * (P[0, k] * P[0, m] + P[1, k] * P[1, m])


@numba.njit(cache=True, parallel=True)
def solve_tracks(
    A: Float, t: Float, image_idx: Int, pointer: Int, xy: Float, weight: Float, X: Float
) -> None:
    """The best point of every track into X (N, 3), nan where its rays do not fix one."""
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


@numba.njit(cache=True, parallel=True)
def fill_residuals(
    A: Float, t: Float, X: Float, image_idx: Int, track_idx: Int, xy: Float, r: Float
) -> None:
    """``A_i X_j + t_i - xy`` into r (O, 2)."""
    for o in numba.prange(len(image_idx)):
        i, j = image_idx[o], track_idx[o]
        for d in range(2):
            r[o, d] = (A[i, d, 0] * X[j, 0] + A[i, d, 1] * X[j, 1] + A[i, d, 2] * X[j, 2]) + (
                t[i, d] - xy[o, d]
            )


@numba.njit(cache=True, parallel=True)
def fit_tracks(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    precision: Float,
    number: int,
    w2: float,
    rounds: int,
    chunk: Int,
    X: Float,
    r: Float,
    w: Float,
    cost: Float,
) -> None:
    """Points X, residuals r, weights w (which give the first round's) and cost of each chunk.

    Parameters
    ----------
    number, w2 : of the loss and its width squared
    chunk : (C + 1,) where each chunk of tracks begins

    """
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
