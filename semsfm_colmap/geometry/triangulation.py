"""Robust triangulation of tracks with known cameras [paper, section "3D reconstruction"].

Two parallel-projection views fix a point (four equations, three unknowns). For each track pairs of
its views are tried, the one with the most observations within the threshold wins, ties go to the
smaller error, and the point is fitted to its supporters. With few views all pairs are tried; with
many, pairs drawn by a generator that depends on the seed and the track alone, so the result does
not depend on the number of threads.
"""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.points import add_observation, invert_symmetric
from semsfm_colmap.types import Bool, Float, Int

SMALLEST_SHARE = 1e-3
"""Share of the noise's variance that a residual keeps at least, in `drop_deviating`: an observation
that alone fixes a point leaves none."""


@numba.njit(cache=True)
def _next_random(state):  # type: ignore[no-untyped-def]
    """xorshift64*: enough to draw pairs, reproducible in any thread."""
    state ^= state >> np.uint64(12)
    state ^= state << np.uint64(25)
    state ^= state >> np.uint64(27)
    return state


@numba.njit(cache=True)
def _fit(A, t, image_idx, xy, inlier, begin, end, X):  # type: ignore[no-untyped-def]
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
def _support(A, t, image_idx, xy, begin, end, X, limit2, inlier):  # type: ignore[no-untyped-def]
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
def _triangulate(  # type: ignore[no-untyped-def]
    A, t, image_idx, pointer, xy, limit2, trials, seed, X, inlier
):
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
                    state = _next_random(state)
                    a = np.int64(state % np.uint64(n))
                    state = _next_random(state)
                    b = np.int64(state % np.uint64(n - 1))
                    if b >= a:
                        b += 1
                pair[:] = False
                pair[a] = pair[b] = True
            if not _fit(A, t, image_idx[begin:end], xy[begin:end], pair, 0, n, point):
                continue
            count, error = _support(
                A, t, image_idx[begin:end], xy[begin:end], 0, n, point, limit2, flags
            )
            if count > best_count or (count == best_count and error < best_error):
                best_count, best_error = count, error
                best[:] = point
                if k < 0 and count == n:
                    break
        if best_count < 2:
            continue
        _support(A, t, image_idx, xy, begin, end, best, limit2, inlier)
        for _ in range(2):
            if not _fit(A, t, image_idx, xy, inlier, begin, end, point):
                break
            count, error = _support(A, t, image_idx, xy, begin, end, point, limit2, inlier)
            best[:] = point
            if count < 2:
                break
        X[j, :] = best


def triangulate_tracks(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    *,
    threshold_px: float,
    trials: int,
    seed: int = 0,
) -> tuple[Float, Bool]:
    """Points of all tracks and the observations that support them.

    Parameters
    ----------
    A, t : (M, 2, 3), (M, 2) cameras
    image_idx, xy : (O,), (O, 2), sorted by track
    pointer : (N + 1,)
    threshold_px : reprojection error up to which an observation supports a point

    Returns
    -------
    X : (N, 3), nan where no two views agree
    inlier : (O,)

    """
    num_tracks = len(pointer) - 1
    X = np.full((num_tracks, 3), np.nan)
    inlier = np.zeros(len(image_idx), dtype=bool)
    _triangulate(A, t, image_idx, pointer, xy, threshold_px**2, trials, seed, X, inlier)
    return X, inlier


@numba.njit(cache=True, parallel=True)
def _drop_deviating(A, t, image_idx, pointer, xy, limit2, min_length, inlier):  # type: ignore[no-untyped-def]
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


def drop_deviating(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    inlier: Bool,
    *,
    threshold_px: float,
    min_length: int,
) -> Bool:
    """Drop observations that the rest of their track contradicts, the worst first: (O,).

    An observation pulls the point toward itself, the more the further its direction lies from the
    others', and the residual that it leaves is the smaller for it: with M = I - P H^-1 P^T its
    covariance is sigma^2 M, H the sum of P^T P over the track. So ``r^T M^-1 r``, a chi square in
    units of sigma^2 wherever the observation lies, is held against the threshold [Baarda 1968].

    Parameters
    ----------
    A, t, image_idx, pointer, xy, inlier : as `triangulate_tracks` takes and gives them
    min_length : tracks of fewer observations are left as they are

    """
    kept = np.array(inlier)
    _drop_deviating(A, t, image_idx, pointer, xy, threshold_px**2, min_length, kept)
    return kept


@numba.njit(cache=True, parallel=True)
def _widest_angle(direction, image_idx, pointer, inlier, cosine):  # type: ignore[no-untyped-def]
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


def triangulation_angle(direction: Float, image_idx: Int, pointer: Int, inlier: Bool) -> Float:
    """The widest angle between two viewing directions of each track: (N,) rad."""
    cosine = np.ones(len(pointer) - 1)
    _widest_angle(np.ascontiguousarray(direction), image_idx, pointer, inlier, cosine)
    return np.arccos(np.clip(cosine, -1.0, 1.0))
