"""Compiled kernel of the plane sweep: window correlation for every pixel and plane."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array

MAX_COST = 100
"""Cost of no correlation; ``cost = MAX_COST (1 - max(ncc, 0))``."""
_BLOCK = 8
"""Planes computed before they are written to the volume, where a pixel's planes are neighbours."""


@numba.njit(nogil=True, fastmath=True, cache=True)
def correlation_volume(
    reference: Array,
    base: Array,
    views: Array,
    view_usable: Array,
    B: Array,
    c: Array,
    e: Array,
    offsets: Array,
    radius: int,
    noise: Array,
    side: Array,
) -> Array:
    """Matching cost of each pixel at each offset from a base surface.

    With a constant base this sweeps planes; a base that follows the specimen makes the windows lie
    on its slopes. The neighbours are resampled into the reference's grid over ``base + offset`` and
    correlated with it in windows of (2 radius + 1)^2 px: ``ncc = cov / sqrt((var_r + n_r^2)
    (var_j + n_j^2))``. The noise variances n^2 in the denominator take windows without texture to
    0. Neighbours are averaged on each side of the reference and the better side counts: what one
    side hides, the other sees (Kang, Szeliski, Chai, CVPR 2001).

    Parameters
    ----------
    reference : (H, W) float32
    base : (H, W) float32 depths
    views : (V, H', W') float32, padded to a common size
    view_usable : (V, H', W') uint8
    B, c, e : the maps of `AffineSweep`
    offsets : (D,) float64
    noise : (1 + V,) deviations, the reference's first
    side : (V,) 0 or 1

    Returns
    -------
    (H, W, D) uint8, MAX_COST at the border and where no neighbour sees the point

    """
    H, W = reference.shape
    V = len(views)
    D = len(offsets)
    size = 2 * radius + 1
    inv_n = np.float32(1.0 / (size * size))
    cost = np.full((H, W, D), MAX_COST, dtype=np.uint8)

    mean_r = np.zeros((H, W), dtype=np.float32)
    inv_r = np.zeros((H, W), dtype=np.float32)
    _window_moments(reference, radius, inv_n, np.float32(noise[0] ** 2), mean_r, inv_r)

    warped = np.zeros((H, W), dtype=np.float32)
    seen = np.zeros((H, W), dtype=np.float32)
    columns = np.zeros((3, W), dtype=np.float32)
    sums = np.zeros((3, W), dtype=np.float32)
    total = np.zeros((2, H, W), dtype=np.float32)
    count = np.zeros((2, H, W), dtype=np.float32)
    block = np.full((_BLOCK, H, W), MAX_COST, dtype=np.uint8)
    one, zero, tiny = np.float32(1.0), np.float32(0.0), np.float32(1e-6)
    for k in range(D):
        total[:] = zero
        count[:] = zero
        for j in range(V):
            shift = c[j] * offsets[k] + e[j]
            _warp(views[j], view_usable[j], B[j], c[j], shift, base, warped, seen)
            noise_j = np.float32(noise[1 + j] ** 2)
            for y in range(radius, H - radius):
                _window_sums(warped, reference, y, radius, columns, sums)
                _add_correlation(
                    sums, mean_r[y], inv_r[y], inv_n, noise_j, seen[y], total[side[j], y]
                )
                count[side[j], y] += seen[y]
        for y in range(radius, H - radius):
            for x in range(radius, W - radius):
                left = total[0, y, x] / (count[0, y, x] + tiny)
                right = total[1, y, x] / (count[1, y, x] + tiny)
                share = min(max(max(left, right), zero), one)
                block[k % _BLOCK, y, x] = np.uint8(MAX_COST * (one - share) + np.float32(0.5))
        if k % _BLOCK == _BLOCK - 1 or k == D - 1:
            begin = k - k % _BLOCK
            for y in range(H):
                for x in range(W):
                    for i in range(k + 1 - begin):
                        cost[y, x, begin + i] = block[i, y, x]
    return cost


@numba.njit(nogil=True, fastmath=True, cache=True)
def _warp(
    view: Array,
    usable: Array,
    B: Array,
    c: Array,
    shift: Array,
    base: Array,
    warped: Array,
    seen: Array,
) -> None:
    """Resample a neighbour into the reference's grid, bilinearly, in place."""
    last_u = np.float32(view.shape[1] - 1.01)
    last_v = np.float32(view.shape[0] - 1.01)
    zero, one = np.float32(0.0), np.uint32(1)
    du, dv = np.float32(B[0, 0]), np.float32(B[1, 0])
    cu, cv = np.float32(c[0]), np.float32(c[1])
    for y in range(warped.shape[0]):
        u0 = np.float32(B[0, 0] * 0.5 + B[0, 1] * (y + 0.5) + shift[0] - 0.5)
        v0 = np.float32(B[1, 0] * 0.5 + B[1, 1] * (y + 0.5) + shift[1] - 0.5)
        for x in range(warped.shape[1]):
            free_u = u0 + du * np.float32(x) + cu * base[y, x]
            free_v = v0 + dv * np.float32(x) + cv * base[y, x]
            u = min(max(free_u, zero), last_u)
            v = min(max(free_v, zero), last_v)
            iu, iv = np.uint32(u), np.uint32(v)
            fu, fv = u - np.float32(iu), v - np.float32(iv)
            top = view[iv, iu] + fu * (view[iv, iu + one] - view[iv, iu])
            low = view[iv + one, iu] + fu * (view[iv + one, iu + one] - view[iv + one, iu])
            warped[y, x] = top + fv * (low - top)
            inside = (u == free_u) & (v == free_v) & (usable[iv, iu] > 0)
            seen[y, x] = np.float32(inside)


@numba.njit(nogil=True, fastmath=True, cache=True)
def _window_sums(
    warped: Array, reference: Array, y: int, radius: int, columns: Array, sums: Array
) -> None:
    """Sums of w, w^2 and w r over the windows of one row: first columns, then along the row."""
    W = warped.shape[1]
    columns[:] = 0.0
    for dy in range(-radius, radius + 1):
        for x in range(W):
            value = warped[y + dy, x]
            columns[0, x] += value
            columns[1, x] += value * value
            columns[2, x] += value * reference[y + dy, x]
    sums[:] = 0.0
    for i in range(3):
        for dx in range(2 * radius + 1):
            for x in range(W - 2 * radius):
                sums[i, x + radius] += columns[i, x + dx]


@numba.njit(nogil=True, fastmath=True, cache=True)
def _add_correlation(
    sums: Array,
    mean_r: Array,
    inverse_r: Array,
    inv_n: float,
    noise_var: float,
    seen: Array,
    total: Array,
) -> None:
    """Add the correlation of one row's windows where the neighbour sees them, in place."""
    for x in range(len(total)):
        mean = sums[0, x] * inv_n
        variance = max(sums[1, x] * inv_n - mean * mean, np.float32(0.0)) + noise_var
        covariance = sums[2, x] * inv_n - mean * mean_r[x]
        total[x] += covariance * inverse_r[x] / math.sqrt(variance) * seen[x]


@numba.njit(nogil=True, fastmath=True, cache=True)
def _window_moments(
    image: Array, radius: int, inv_n: float, noise_var: float, mean: Array, inverse: Array
) -> None:
    """Window mean, and 1 / sqrt(variance + noise), in place."""
    H, W = image.shape
    for y in range(radius, H - radius):
        for x in range(radius, W - radius):
            s = np.float32(0.0)
            ss = np.float32(0.0)
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    value = image[y + dy, x + dx]
                    s += value
                    ss += value * value
            m = s * inv_n
            mean[y, x] = m
            inverse[y, x] = 1.0 / math.sqrt(max(float(ss * inv_n - m * m), 0.0) + noise_var)
