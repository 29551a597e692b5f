"""Compiled kernel of local planes: the slopes of a depth map.

Sums over a window run over a piece of a row at a time, one offset after the other, so that every
loop is over neighbours in memory and is vectorised.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array

PIECE = 256
"""Pixels of a row whose sums are kept at a time: they stay in the fastest cache."""
_RIDGE = 0.1
"""px^2 added to the variance of the places: keeps one-sided fits from tilting."""
EXACT = {"nsz", "arcp", "contract", "afn", "reassoc"}
"""Fast arithmetic in which nan stays nan: depths that are not there are nan."""


@numba.njit(nogil=True, fastmath=EXACT, cache=True, error_model="numpy")
def local_planes(depth: Array, weight: Array, radius: int, tolerance: float) -> Array:
    """Robust plane through the depths around each pixel.

    With d the offset of a neighbour and dz its depth less the centre's, minimise
    ``sum w (z + (p, q) . d - dz)^2``. Neighbours with ``|dz| > tolerance (1 + |d|)`` belong to
    another surface and do not count.

    Parameters
    ----------
    depth : (H, W) float32, nan where there is none
    weight : (H, W) float32, not negative
    radius : the window has (2 radius + 1)^2 px
    tolerance : world units per px

    Returns
    -------
    (3, H, W) float32: fitted depth at the centre and slopes along x and y, nan without support

    """
    H, W = depth.shape
    out = np.full((3, H, W), np.nan, dtype=np.float32)
    moments = np.zeros((9, PIECE), dtype=np.float32)
    row = np.zeros((5, PIECE), dtype=np.float32)
    w = np.zeros(PIECE, dtype=np.float32)
    wz = np.zeros(PIECE, dtype=np.float32)
    one = np.float32(1.0)
    for y in range(H):
        for start in range(0, W, PIECE):
            first, last = span(depth[y], start, min(start + PIECE, W))
            if first >= last:
                continue
            n = last - first
            moments[:, :n] = 0.0
            for dy in range(max(-radius, -y), min(radius, H - 1 - y) + 1):
                row[:, :n] = 0.0
                for dx in range(-radius, radius + 1):
                    low, high = max(first, -dx), min(last, W - dx)
                    if low >= high:
                        continue
                    begin, end, m = low - first, high - first, high - low
                    bound = np.float32(tolerance * (1.0 + math.hypot(dx, dy)))
                    near = slice(low + dx, high + dx)
                    _select(
                        depth[y, low:high], depth[y + dy, near], weight[y + dy, near], bound, w, wz
                    )
                    x = np.float32(dx)
                    _add(row[0, begin:end], one, w[:m])
                    _add(row[3, begin:end], one, wz[:m])
                    if dx != 0:
                        _add(row[1, begin:end], x, w[:m])
                        _add(row[2, begin:end], x * x, w[:m])
                        _add(row[4, begin:end], x, wz[:m])
                _add_row(moments[:, :n], row[:, :n], np.float32(dy))
            _solve(moments[:, :n], depth[y, first:last], out[:, y, first:last])
    return out


@numba.njit(nogil=True, cache=True)
def span(depth: Array, start: int, end: int) -> tuple[int, int]:
    """The part of a piece of a row in which there are depths."""
    while start < end and not math.isfinite(depth[start]):
        start += 1
    while start < end and not math.isfinite(depth[end - 1]):
        end -= 1
    return start, end


@numba.njit(nogil=True, fastmath=EXACT, cache=True)
def _select(depth: Array, other: Array, weight: Array, bound: float, w: Array, wz: Array) -> None:
    """The weights of the neighbours at one offset, and their products with dz, in place."""
    zero = np.float32(0.0)
    for x in range(len(depth)):
        dz = other[x] - depth[x]
        inside = abs(dz) <= bound
        w[x] = weight[x] if inside else zero
        wz[x] = weight[x] * dz if inside else zero


@numba.njit(nogil=True, fastmath=EXACT, cache=True)
def _add(to: Array, factor: float, values: Array) -> None:
    for x in range(len(to)):
        to[x] += factor * values[x]


@numba.njit(nogil=True, fastmath=EXACT, cache=True)
def _add_row(moments: Array, row: Array, dy: float) -> None:
    """Sums over the window from those over one of its rows, in place.

    ``row``: of w, w x, w x^2, w dz, w x dz; ``moments``: of w, w x, w y, w dz, w x^2, w x y, w y^2,
    w x dz, w y dz.
    """
    one = np.float32(1.0)
    _add(moments[0], one, row[0])
    _add(moments[1], one, row[1])
    _add(moments[2], dy, row[0])
    _add(moments[3], one, row[3])
    _add(moments[4], one, row[2])
    _add(moments[5], dy, row[1])
    _add(moments[6], dy * dy, row[0])
    _add(moments[7], one, row[4])
    _add(moments[8], dy, row[3])


@numba.njit(nogil=True, fastmath=EXACT, cache=True, error_model="numpy")
def _solve(moments: Array, depth: Array, out: Array) -> None:
    """Planes from the sums, in place."""
    one, zero, ridge = np.float32(1.0), np.float32(0.0), np.float32(_RIDGE)
    for i in range(len(depth)):
        if not (math.isfinite(depth[i]) and moments[0, i] > zero):
            continue
        inverse = one / moments[0, i]
        x, y, z = moments[1, i] * inverse, moments[2, i] * inverse, moments[3, i] * inverse
        xx = moments[4, i] * inverse - x * x + ridge
        xy = moments[5, i] * inverse - x * y
        yy = moments[6, i] * inverse - y * y + ridge
        xz = moments[7, i] * inverse - x * z
        yz = moments[8, i] * inverse - y * z
        scale = one / (xx * yy - xy * xy)
        p = (yy * xz - xy * yz) * scale
        q = (xx * yz - xy * xz) * scale
        out[0, i] = depth[i] + z - p * x - q * y
        out[1, i] = p
        out[2, i] = q
