"""Compiled: what a neighbour shows along a row of the reference's pixels.

Of the loops only the one that fetches pixels is not vectorised.
"""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def row_places(B: Array, c: Array, shift: Array, depth: Array, y: int, u: Array, v: Array) -> None:
    """Where a neighbour sees one row of the reference's pixels, in place.

    ``(u, v) = B (x, y) + c depth + shift`` (`AffineSweep`), less the half px by which the centre of
    the first pixel lies within the image.
    """
    u0 = np.float32(B[0, 0] * 0.5 + B[0, 1] * (y + 0.5) + shift[0] - 0.5)
    v0 = np.float32(B[1, 0] * 0.5 + B[1, 1] * (y + 0.5) + shift[1] - 0.5)
    du, dv = np.float32(B[0, 0]), np.float32(B[1, 0])
    cu, cv = np.float32(c[0]), np.float32(c[1])
    for x in range(len(u)):
        u[x] = u0 + du * np.float32(x) + cu * depth[x]
        v[x] = v0 + dv * np.float32(x) + cv * depth[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def row_cells(
    u: Array, v: Array, height: int, width: int, margin: int, at: Array, seen: Array
) -> None:
    """Index of the pixel above and left of each place, and its fractions in `u` and `v`, in place.

    `seen` is 1 where the place lies at least `margin` px within the image; others are moved to its
    border.
    """
    zero, m = np.float32(0.0), np.float32(margin)
    last_u, last_v = np.float32(width - 1.01), np.float32(height - 1.01)
    stride = np.int32(width)
    for x in range(len(u)):
        free_u, free_v = u[x], v[x]
        uu = min(max(free_u, zero), last_u)
        vv = min(max(free_v, zero), last_v)
        inside = (free_u >= m) & (free_v >= m) & (free_u <= last_u - m) & (free_v <= last_v - m)
        seen[x] = np.float32(inside)
        iu, iv = np.int32(uu), np.int32(vv)
        u[x], v[x] = uu - np.float32(iu), vv - np.float32(iv)
        at[x] = np.uint32(iv * stride + iu)


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def row_values(view: Array, at: Array, u: Array, v: Array, corner: Array, values: Array) -> None:
    """Bilinear values of an image at the places of a row, in place; `corner` (4, W) is room."""
    above = view.reshape(-1)
    below = above[view.shape[1] :]
    right = np.uint32(1)
    w00, w01, w10, w11 = corner[0], corner[1], corner[2], corner[3]
    for x in range(len(u)):
        i = at[x]
        w00[x], w01[x] = above[i], above[i + right]
        w10[x], w11[x] = below[i], below[i + right]
    for x in range(len(u)):
        top = w00[x] + u[x] * (w01[x] - w00[x])
        low = w10[x] + u[x] * (w11[x] - w10[x])
        values[x] = top + v[x] * (low - top)


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def row_usable(usable: Array, at: Array, seen: Array) -> None:
    """Set `seen` to 0 where the mask of a neighbour is 0, in place."""
    mask = usable.reshape(-1)
    for x in range(len(seen)):
        seen[x] *= np.float32(mask[at[x]] != 0)
