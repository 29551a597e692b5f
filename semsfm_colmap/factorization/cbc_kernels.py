"""Compiled loops over the columns of a block (see `cbc`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Bool, Float, Int

MISS = 1e-4
"""Chance that RANSAC ends before it has drawn four good columns."""
MIN_INDEPENDENT = 1e-10
"""Squared share of a column that must be new for four columns to span a subspace."""


@numba.njit(cache=True)
def centred_basis(M: Float) -> tuple[Float, Float, Float]:
    """Row mean, left singular vectors and singular values of the centred M (2 m, n)."""
    rows, n = M.shape
    mean = np.empty(rows)
    centred = np.empty((rows, n))
    for d in range(rows):
        mean[d] = np.sum(M[d]) / n
        for j in range(n):
            centred[d, j] = M[d, j] - mean[d]
    values, vectors = np.linalg.eigh(centred @ centred.T)
    U = np.empty((rows, rows))
    s = np.empty(rows)
    for k in range(rows):
        s[k] = np.sqrt(max(values[rows - 1 - k], 0.0))
        U[:, k] = vectors[:, rows - 1 - k]
    return mean, U, s


@numba.njit(cache=True)
def squared_distances(M: Float, mean: Float, U: Float) -> Float:
    """Squared distance of each column of M to ``mean + span(U)``: (n,)."""
    rows, n = M.shape
    error = np.empty(n)
    D = np.empty(rows)
    for j in range(n):
        total = 0.0
        for d in range(rows):
            D[d] = M[d, j] - mean[d]
            total += D[d] * D[d]
        for k in range(U.shape[1]):
            along = 0.0
            for d in range(rows):
                along += U[d, k] * D[d]
            total -= along * along
        error[j] = total
    return error


@numba.njit(cache=True)
def best_subspace(M: Float, limit: float, picks: Int, order: Int, best: Bool) -> None:
    """Mark in `best` (n,) the columns that agree with the best subspace through four of them.

    Parameters
    ----------
    limit : squared distance up to which a column agrees
    picks : (T, 4) columns to try
    order : (n,) in which columns are counted, so that a poor subspace is left early

    """
    rows, n = M.shape
    Q = np.zeros((3, rows))
    inlier = np.zeros(n, dtype=np.bool_)
    most, trials = 3, len(picks)
    t = 0
    while t < trials:
        pick = picks[t]
        t += 1
        independent = True
        for k in range(3):
            before = 0.0
            for d in range(rows):
                Q[k, d] = M[d, pick[k + 1]] - M[d, pick[0]]
                before += Q[k, d] * Q[k, d]
            for q in range(k):
                dot = 0.0
                for d in range(rows):
                    dot += Q[k, d] * Q[q, d]
                for d in range(rows):
                    Q[k, d] -= dot * Q[q, d]
            norm = 0.0
            for d in range(rows):
                norm += Q[k, d] * Q[k, d]
            if norm <= MIN_INDEPENDENT * before or norm == 0.0:
                independent = False
                break
            norm = np.sqrt(norm)
            for d in range(rows):
                Q[k, d] /= norm
        if not independent:
            continue
        count = 0
        for m in range(n):
            # no longer able to beat the best
            if count + n - m <= most:
                break
            j = order[m]
            e = 0.0
            d0 = 0.0
            d1 = 0.0
            d2 = 0.0
            for d in range(rows):
                x = M[d, j] - M[d, pick[0]]
                e += x * x
                d0 += x * Q[0, d]
                d1 += x * Q[1, d]
                d2 += x * Q[2, d]
            inlier[j] = e - d0 * d0 - d1 * d1 - d2 * d2 < limit
            count += inlier[j]
        if count > most:
            most = count
            best[:] = inlier
            # enough trials to have met four good columns with the confidence asked for
            good = (count / n) ** 4
            if good > 1.0 - 1e-9:
                break
            trials = min(trials, int(np.ceil(np.log(MISS) / np.log(1.0 - good))))
