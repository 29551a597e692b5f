"""Compiled triangulation, one track after the other (see `triangulation`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.points_kernels import add_observation, invert_symmetric
from semsfm_colmap.types import Bool, Float, Int

SMALLEST_SHARE = 1e-3
"""Share of the noise's variance that a residual keeps at least, in `drop_worst`: an observation
that alone fixes a point leaves none."""


@numba.njit(cache=True)
def next_random(state: np.uint64) -> np.uint64:
    """xorshift64*: enough to draw pairs, reproducible in any thread."""
    state ^= state >> np.uint64(12)
    state ^= state << np.uint64(25)
    state ^= state >> np.uint64(27)
    return state


@numba.njit(cache=True)
def fit_point(
    A: Float, t: Float, image_idx: Int, xy: Float, inlier: Bool, begin: int, end: int, X: Float
) -> bool:
    """The best point for the inliers among observations begin ... end; False when they fix none."""
    H = np.zeros((3, 3))
    b = np.zeros(3)
    inverse = np.zeros((3, 3))
    for o in range(begin, end):
        if inlier[o]:
            i = image_idx[o]
            add_observation(H, b, A[i], xy[o, 0] - t[i, 0], xy[o, 1] - t[i, 1], 1.0)
    if not invert_symmetric(H, inverse):
        return False
    for k in range(3):
        X[k] = inverse[k, 0] * b[0] + inverse[k, 1] * b[1] + inverse[k, 2] * b[2]
    return True


@numba.njit(cache=True)
def mark_support(
    A: Float,
    t: Float,
    image_idx: Int,
    xy: Float,
    begin: int,
    end: int,
    X: Float,
    limit2: float,
    inlier: Bool,
) -> tuple[int, float]:
    """Mark the supporters of X; returns their number and truncated error."""
    count = 0
    error = 0.0
    for o in range(begin, end):
        i = image_idx[o]
        du = A[i, 0, 0] * X[0] + A[i, 0, 1] * X[1] + A[i, 0, 2] * X[2] + t[i, 0] - xy[o, 0]
        dv = A[i, 1, 0] * X[0] + A[i, 1, 1] * X[1] + A[i, 1, 2] * X[2] + t[i, 1] - xy[o, 1]
        e = du * du + dv * dv
        inlier[o] = e < limit2
        if e < limit2:
            count += 1
            error += e
        else:
            error += limit2
    return count, error


@numba.njit(cache=True, parallel=True)
def triangulate(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    limit2: float,
    trials: int,
    seed: int,
    X: Float,
    inlier: Bool,
) -> None:
    """Points X (N, 3) of all tracks, nan where no two views agree, and their supporters (O,)."""
    for j in numba.prange(len(pointer) - 1):
        begin, end = pointer[j], pointer[j + 1]
        n = end - begin
        X[j, 0] = X[j, 1] = X[j, 2] = np.nan
        for o in range(begin, end):
            inlier[o] = False
        if n < 2:
            continue
        all_pairs = n * (n - 1) // 2
        exhaustive = all_pairs <= trials
        rounds = all_pairs if exhaustive else trials
        state = np.uint64(seed) * np.uint64(2654435761) + np.uint64(j + 1) * np.uint64(
            11400714819323198485
        )
        point = np.zeros(3)
        best = np.zeros(3)
        pair = np.zeros(n, dtype=np.bool_)
        flags = np.zeros(n, dtype=np.bool_)
        best_count = -1
        best_error = np.inf
        # the fit to all observations is the first candidate: usually it is the answer
        a = np.int64(0)
        b = np.int64(0)
        for k in range(-1, rounds):
            if k < 0:
                pair[:] = True
            else:
                if exhaustive:
                    b += 1
                    if b >= n:
                        a += 1
                        b = a + 1
                else:
                    state = next_random(state)
                    a = np.int64(state % np.uint64(n))
                    state = next_random(state)
                    b = np.int64(state % np.uint64(n - 1))
                    if b >= a:
                        b += 1
                pair[:] = False
                pair[a] = pair[b] = True
            if not fit_point(A, t, image_idx[begin:end], xy[begin:end], pair, 0, n, point):
                continue
            count, error = mark_support(
                A, t, image_idx[begin:end], xy[begin:end], 0, n, point, limit2, flags
            )
            if count > best_count or (count == best_count and error < best_error):
                best_count, best_error = count, error
                best[:] = point
                if k < 0 and count == n:
                    break
        if best_count < 2:
            continue
        mark_support(A, t, image_idx, xy, begin, end, best, limit2, inlier)
        for _ in range(2):
            if not fit_point(A, t, image_idx, xy, inlier, begin, end, point):
                break
            count, error = mark_support(A, t, image_idx, xy, begin, end, point, limit2, inlier)
            best[:] = point
            if count < 2:
                break
        X[j, :] = best


@numba.njit(cache=True, parallel=True)
def drop_worst(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    limit2: float,
    min_length: int,
    inlier: Bool,
) -> None:
    """Take the worst inlier out of each track until none lies beyond the limit."""
    for j in numba.prange(len(pointer) - 1):
        begin, end = pointer[j], pointer[j + 1]
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        X = np.zeros(3)
        count = 0
        for o in range(begin, end):
            count += inlier[o]
        while count >= min_length:
            H[:] = 0.0
            b[:] = 0.0
            for o in range(begin, end):
                if inlier[o]:
                    i = image_idx[o]
                    add_observation(H, b, A[i], xy[o, 0] - t[i, 0], xy[o, 1] - t[i, 1], 1.0)
            if not invert_symmetric(H, inverse):
                break
            for k in range(3):
                X[k] = inverse[k, 0] * b[0] + inverse[k, 1] * b[1] + inverse[k, 2] * b[2]
            worst, most = -1, limit2
            for o in range(begin, end):
                if not inlier[o]:
                    continue
                P, s = A[image_idx[o]], t[image_idx[o]]
                du = P[0, 0] * X[0] + P[0, 1] * X[1] + P[0, 2] * X[2] + s[0] - xy[o, 0]
                dv = P[1, 0] * X[0] + P[1, 1] * X[1] + P[1, 2] * X[2] + s[1] - xy[o, 1]
                m00, m01, m11 = 1.0 + SMALLEST_SHARE, 0.0, 1.0 + SMALLEST_SHARE
                for k in range(3):
                    for m in range(3):
                        m00 -= P[0, k] * inverse[k, m] * P[0, m]
                        m01 -= P[0, k] * inverse[k, m] * P[1, m]
                        m11 -= P[1, k] * inverse[k, m] * P[1, m]
                q = (m11 * du * du - 2.0 * m01 * du * dv + m00 * dv * dv) / (m00 * m11 - m01 * m01)
                if q > most:
                    worst, most = o, q
            if worst < 0:
                break
            inlier[worst] = False
            count -= 1


@numba.njit(cache=True, parallel=True)
def smallest_cosine(
    direction: Float, image_idx: Int, pointer: Int, inlier: Bool, cosine: Float
) -> None:
    """Cosine of the widest angle between two inliers' directions (M, 3) of each track: (N,)."""
    for j in numba.prange(len(pointer) - 1):
        low = 1.0
        for a in range(pointer[j], pointer[j + 1]):
            if not inlier[a]:
                continue
            d = direction[image_idx[a]]
            for b in range(pointer[j], a):
                if inlier[b]:
                    e = direction[image_idx[b]]
                    low = min(low, d[0] * e[0] + d[1] * e[1] + d[2] * e[2])
        cosine[j] = low
