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

    # what a row needs: places and greys of a neighbour, sums over columns and over windows
    u = np.zeros(W, dtype=np.float32)
    v = np.zeros(W, dtype=np.float32)
    at = np.zeros(W, dtype=np.uint32)
    corner = np.zeros((5, W), dtype=np.float32)
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
                _places(B[j], c[j], shift, base[y], y, u, v)
                _warp_row(
                    views[j],
                    view_usable[j],
                    u,
                    v,
                    reference[y],
                    at,
                    corner,
                    ring[slot],
                    seen[slot],
                )
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
def _places(B: Array, c: Array, shift: Array, base: Array, y: int, u: Array, v: Array) -> None:
    """Where a neighbour sees one row of the reference's pixels, in place."""
    u0 = np.float32(B[0, 0] * 0.5 + B[0, 1] * (y + 0.5) + shift[0] - 0.5)
    v0 = np.float32(B[1, 0] * 0.5 + B[1, 1] * (y + 0.5) + shift[1] - 0.5)
    du, dv = np.float32(B[0, 0]), np.float32(B[1, 0])
    cu, cv = np.float32(c[0]), np.float32(c[1])
    for x in range(len(u)):
        u[x] = u0 + du * np.float32(x) + cu * base[x]
        v[x] = v0 + dv * np.float32(x) + cv * base[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _warp_row(
    view: Array,
    usable: Array,
    u: Array,
    v: Array,
    reference: Array,
    at: Array,
    corner: Array,
    ring: Array,
    seen: Array,
) -> None:
    """Greys w of a neighbour at the places of one row, bilinear: w, w^2 and w r, in place.

    Three loops, of which only the one that fetches the four corners is not vectorised. `u` and `v`
    become the fractions of the places; `at`, `corner` are room for what lies between the loops.
    """
    last_u = np.float32(view.shape[1] - 1.01)
    last_v = np.float32(view.shape[0] - 1.01)
    width, zero, right = np.int32(view.shape[1]), np.float32(0.0), np.uint32(1)
    above, mask = view.reshape(-1), usable.reshape(-1)
    below = above[view.shape[1] :]
    for x in range(len(u)):
        free_u, free_v = u[x], v[x]
        uu = min(max(free_u, zero), last_u)
        vv = min(max(free_v, zero), last_v)
        seen[x] = np.float32((uu == free_u) & (vv == free_v))
        iu, iv = np.int32(uu), np.int32(vv)
        u[x], v[x] = uu - np.float32(iu), vv - np.float32(iv)
        at[x] = np.uint32(iv * width + iu)
    w00, w01, w10, w11, usable_at = corner[0], corner[1], corner[2], corner[3], corner[4]
    for x in range(len(u)):
        i = at[x]
        w00[x], w01[x] = above[i], above[i + right]
        w10[x], w11[x] = below[i], below[i + right]
        usable_at[x] = mask[i]
    grey, square, product = ring[0], ring[1], ring[2]
    for x in range(len(u)):
        top = w00[x] + u[x] * (w01[x] - w00[x])
        low = w10[x] + u[x] * (w11[x] - w10[x])
        w = top + v[x] * (low - top)
        seen[x] *= min(usable_at[x], np.float32(1.0))
        grey[x] = w
        square[x] = w * w
        product[x] = w * reference[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _window_sums(ring: Array, sums: Array, radius: int) -> None:
    """Sums of w, w^2 and w r over the windows of one row: first columns, then along the row.

    ``sums[:3]`` holds those of the columns; ``sums[3:, x]`` is of the window that begins at x.
    """
    W = sums.shape[1]
    for m in range(3):
        column, window = sums[m], sums[3 + m]
        first = ring[0, m]
        for x in range(W):
            column[x] = first[x]
        for i in range(1, 2 * radius + 1):
            row = ring[i, m]
            for x in range(W):
                column[x] += row[x]
        for x in range(W - 2 * radius):
            window[x] = column[x]
        for i in range(1, 2 * radius + 1):
            right = column[i:]
            for x in range(W - 2 * radius):
                window[x] += right[x]


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
