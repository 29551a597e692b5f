"""Compiled search for the nearest descriptors within a window (see `windows`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.matching.nearest_kernels import apart
from semsfm_colmap.types import Array


@numba.njit(nogil=True, cache=True)
def search_windows(
    values1: Array,
    values2: Array,
    xy1: Array,
    xy2: Array,
    centre: Array,
    direction: Array,
    low: float,
    high: float,
    across: float,
    cell_begin: Array,
    origin: Array,
    cell_px: float,
    exclusion: float,
    row_index: Array,
    row_best: Array,
    row_second: Array,
    column_index: Array,
    column_best: Array,
    column_second: Array,
) -> None:
    """The two nearest of each keypoint among those in its window, in both directions.

    Parameters
    ----------
    values1, values2 : (n1, D), (n2, D) int16 descriptors; the second set is ordered by cells
    xy1, xy2 : (n1, 2), (n2, 2) positions
    centre : (n1, 2) middle of each keypoint's window in the second image
    direction : (2,) unit vector along the windows, which reach from `low` to `high` along it and
        `across` to either side
    cell_begin : (rows, columns + 1) first keypoint of the second image in each cell; `origin` (2,)
        is the corner of the first cell, `cell_px` the width of all
    exclusion : see `nearest_kernels.search_block`
    row_*, column_* : (n1,), (n2,) results, changed in place; distances squared

    """
    n1, D = values1.shape
    n_rows, n_columns = cell_begin.shape[0], cell_begin.shape[1] - 1
    ux, uy = direction[0], direction[1]
    half_x = across * abs(uy)
    half_y = across * abs(ux)
    x_low, x_high = min(low * ux, high * ux) - half_x, max(low * ux, high * ux) + half_x
    y_low, y_high = min(low * uy, high * uy) - half_y, max(low * uy, high * uy) + half_y
    for i in range(n1):
        cx, cy = centre[i, 0], centre[i, 1]
        first_column = max(int(np.floor((cx + x_low - origin[0]) / cell_px)), 0)
        last_column = min(int(np.floor((cx + x_high - origin[0]) / cell_px)), n_columns - 1)
        first_row = max(int(np.floor((cy + y_low - origin[1]) / cell_px)), 0)
        last_row = min(int(np.floor((cy + y_high - origin[1]) / cell_px)), n_rows - 1)
        best, second, index = np.int32(2**31 - 1), np.int32(2**31 - 1), -1
        for row in range(first_row, last_row + 1):
            if last_column < first_column:
                break
            for j in range(cell_begin[row, first_column], cell_begin[row, last_column + 1]):
                dx, dy = xy2[j, 0] - cx, xy2[j, 1] - cy
                along = dx * ux + dy * uy
                if along < low or along > high or abs(dx * uy - dy * ux) > across:
                    continue
                d = np.int32(0)
                for k in range(D):
                    e = np.int32(values1[i, k]) - np.int32(values2[j, k])
                    d += e * e
                if d < second:
                    if d < best:
                        if index < 0 or apart(xy2, index, j, exclusion):
                            second = best
                        best, index = d, j
                    elif apart(xy2, index, j, exclusion):
                        second = d
                if d < column_second[j]:
                    other = column_index[j]
                    if d < column_best[j]:
                        if other < 0 or apart(xy1, other, i, exclusion):
                            column_second[j] = column_best[j]
                        column_best[j] = d
                        column_index[j] = i
                    elif apart(xy1, other, i, exclusion):
                        column_second[j] = d
        row_index[i], row_best[i], row_second[i] = index, best, second
