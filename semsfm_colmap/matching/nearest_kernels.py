"""Compiled search of a block of distances (see `nearest`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, cache=True, inline="always")
def apart(xy: Array, a: int, b: int, exclusion: float) -> bool:
    """True when two positions are farther from each other than `exclusion`."""
    if exclusion < 0.0:
        return True
    dx, dy = xy[a, 0] - xy[b, 0], xy[a, 1] - xy[b, 1]
    return dx * dx + dy * dy > exclusion * exclusion


@numba.njit(nogil=True, cache=True)
def search_block(
    product: Array,
    norm1: Array,
    norm2: Array,
    first_row: int,
    row_index: Array,
    row_best: Array,
    row_second: Array,
    column_index: Array,
    column_best: Array,
    column_second: Array,
    xy1: Array,
    xy2: Array,
    exclusion: float,
) -> None:
    """Update the two smallest ``norm1[i] + norm2[j] - 2 product[i, j]`` of rows and columns.

    Parameters
    ----------
    product : (r, n2) float32 scalar products; first_row : number of its first row
    row_* : (r,) and column_* : (n2,) results, changed in place
    xy1 : (n1, 2), xy2 : (n2, 2) positions of all; a second nearest within `exclusion` of the
        nearest is the same spot and does not count; below 0 none is excluded

    """
    r, n2 = product.shape
    distance = np.empty(n2, dtype=np.float32)
    two, zero = np.float32(2.0), np.float32(0.0)
    for i in range(r):
        row = product[i]
        n1 = norm1[i]
        smallest = np.float32(np.inf)
        # this loop vectorises; the branches below are rarely taken
        for j in range(n2):
            d = max(n1 + norm2[j] - two * row[j], zero)
            distance[j] = d
            smallest = min(smallest, d)
        best, second, index = row_best[i], row_second[i], row_index[i]
        for j in range(n2):
            d = distance[j]
            if d < second:
                if d < best:
                    if index < 0 or apart(xy2, index, j, exclusion):
                        second = best
                    best, index = d, j
                elif apart(xy2, index, j, exclusion):
                    second = d
            if d < column_second[j]:
                k = column_index[j]
                if d < column_best[j]:
                    if k < 0 or apart(xy1, k, first_row + i, exclusion):
                        column_second[j] = column_best[j]
                    column_best[j] = d
                    column_index[j] = first_row + i
                elif apart(xy1, k, first_row + i, exclusion):
                    column_second[j] = d
        row_best[i], row_second[i], row_index[i] = best, second, index
