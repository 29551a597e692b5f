"""Compiled kernel of the plane sweep: window correlation for every pixel and plane."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.surface.stereo.warp_kernels import (
    row_cells,
    row_places,
    row_usable,
    row_values,
)
from semsfm_colmap.types import Array

MAX_COST = 100
"""Cost of no correlation; ``cost = MAX_COST (1 - max(ncc, 0))``."""
LANES = 16
"""A pixel's costs fill whole vectors of so many 16-bit integers: half the time of `sgm_kernels`."""
_BLOCK = 8
"""Planes computed before they are written to the volume, where a pixel's planes are neighbours."""


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
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
    (H, W, D') uint8, MAX_COST at the border and where no neighbour sees the point, and at the end
    of each pixel's costs, which D' >= D makes a multiple of LANES

    """
    H, W = reference.shape
    V = len(views)
    D = len(offsets)
    size = 2 * radius + 1
    inv_n = np.float32(1.0 / (size * size))
    cost = np.full((H, W, D + -D % LANES), MAX_COST, dtype=np.uint8)

    mean_r = np.zeros((H, W), dtype=np.float32)
    inv_r = np.zeros((H, W), dtype=np.float32)
    _window_moments(reference, radius, inv_n, np.float32(noise[0] ** 2), mean_r, inv_r)

    # what a row needs: places and greys of a neighbour, sums over columns and over windows
    u = np.zeros(W, dtype=np.float32)
    v = np.zeros(W, dtype=np.float32)
    at = np.zeros(W, dtype=np.uint32)
    corner = np.zeros((4, W), dtype=np.float32)
    ring = np.zeros((size, 3, W), dtype=np.float32)
    seen = np.zeros((size, W), dtype=np.float32)
    sums = np.zeros((6, W), dtype=np.float32)
    total = np.zeros((2, H, W), dtype=np.float32)
    count = np.zeros((2, H, W), dtype=np.float32)
    block = np.full((_BLOCK, H, W), MAX_COST, dtype=np.uint8)
    for k in range(D):
        total[:] = np.float32(0.0)
        count[:] = np.float32(0.0)
        for j in range(V):
            noise_j = np.float32(noise[1 + j] ** 2)
            shift = c[j] * offsets[k] + e[j]
            for y in range(H):
                slot = y % size
                row_places(B[j], c[j], shift, base[y], y, u, v)
                row_cells(u, v, views.shape[1], views.shape[2], 0, at, seen[slot])
                row_usable(view_usable[j], at, seen[slot])
                row_values(views[j], at, u, v, corner, ring[slot, 0])
                _products(ring[slot, 0], reference[y], ring[slot, 1], ring[slot, 2])
                if y >= 2 * radius:
                    yc = y - radius
                    _window_sums(ring, sums, radius)
                    _add_correlation(
                        sums[3:],
                        mean_r[yc, radius:],
                        inv_r[yc, radius:],
                        inv_n,
                        noise_j,
                        seen[yc % size, radius:],
                        W - 2 * radius,
                        total[side[j], yc, radius:],
                        count[side[j], yc, radius:],
                    )
        for y in range(radius, H - radius):
            _better_side(total[:, y], count[:, y], radius, block[k % _BLOCK, y])
        if k % _BLOCK == _BLOCK - 1 or k == D - 1:
            begin = k - k % _BLOCK
            _write_block(block[: k + 1 - begin], cost[:, :, begin : k + 1])
    return cost


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _products(grey: Array, reference: Array, square: Array, product: Array) -> None:
    """w^2 and w r of one row of the greys w of a neighbour, in place."""
    for x in range(len(grey)):
        square[x] = grey[x] * grey[x]
        product[x] = grey[x] * reference[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _window_sums(ring: Array, sums: Array, radius: int) -> None:
    """Sums of w, w^2 and w r over the windows of one row: first columns, then along the row.

    ``sums[:3]`` holds those of the columns; ``sums[3:, x]`` is of the window that begins at x. Each
    loop adds two rows, or two columns: half the writing.
    """
    W = sums.shape[1]
    for m in range(3):
        column, window = sums[m], sums[3 + m]
        first = ring[0, m]
        for x in range(W):
            column[x] = first[x]
        for i in range(1, 2 * radius + 1, 2):
            row, next_row = ring[i, m], ring[i + 1, m]
            for x in range(W):
                column[x] += row[x] + next_row[x]
        for x in range(W - 2 * radius):
            window[x] = column[x]
        for i in range(1, 2 * radius + 1, 2):
            right, next_right = column[i:], column[i + 1 :]
            for x in range(W - 2 * radius):
                window[x] += right[x] + next_right[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _add_correlation(
    sums: Array,
    mean_r: Array,
    inverse_r: Array,
    inv_n: float,
    noise_var: float,
    seen: Array,
    num: int,
    total: Array,
    count: Array,
) -> None:
    """Add the correlation of one row's windows where the neighbour sees them, in place."""
    w, square, product = sums[0], sums[1], sums[2]
    for x in range(num):
        mean = w[x] * inv_n
        variance = max(square[x] * inv_n - mean * mean, np.float32(0.0)) + noise_var
        covariance = product[x] * inv_n - mean * mean_r[x]
        total[x] += covariance * inverse_r[x] / np.sqrt(variance) * seen[x]
        count[x] += seen[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _better_side(total: Array, count: Array, radius: int, cost: Array) -> None:
    """Cost of one row from the mean correlations of the two sides, in place."""
    one, zero, tiny = np.float32(1.0), np.float32(0.0), np.float32(1e-6)
    for x in range(radius, len(cost) - radius):
        left = total[0, x] / (count[0, x] + tiny)
        right = total[1, x] / (count[1, x] + tiny)
        share = min(max(max(left, right), zero), one)
        cost[x] = np.uint8(np.int32(np.float32(MAX_COST) * (one - share) + np.float32(0.5)))


@numba.njit(nogil=True, cache=True)
def _write_block(block: Array, cost: Array) -> None:
    """Planes (n, H, W), row by row, to where a pixel's planes are neighbours: (H, W, n)."""
    n, H, W = block.shape
    for y in range(H):
        row, to = block[:, y], cost[y]
        if n == _BLOCK:  # of known length, so that the loop over planes is unrolled
            for x in range(W):
                for i in range(_BLOCK):
                    to[x, i] = row[i, x]
        else:
            for i in range(n):
                for x in range(W):
                    to[x, i] = row[i, x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
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
