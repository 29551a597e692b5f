"""Compiled kernel that drops vertical lines on a triangle surface."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array

EDGE = 1e-9
"""A grid node this far outside of a triangle, relative to its size, still lies on its edge."""


@numba.njit(nogil=True, cache=True)
def topmost(corner: Array, value: Array, num_rows: int, num_columns: int) -> tuple[Array, ...]:
    """The highest and the lowest crossing of the vertical line at every node of a grid.

    Parameters
    ----------
    corner : (F, 3, 3) corners of the triangles: column, row, height; columns and rows in cells
    value : (F, 3) another quantity at the corners, taken along with the highest crossing

    Returns
    -------
    top, bottom, value at the top : (num_rows, num_columns), nan where no triangle is met

    """
    top = np.full((num_rows, num_columns), np.nan)
    bottom = np.full((num_rows, num_columns), np.nan)
    taken = np.full((num_rows, num_columns), np.nan)
    for f in range(len(corner)):
        ax, ay, az = corner[f, 0]
        bx, by, bz = corner[f, 1]
        cx, cy, cz = corner[f, 2]
        det = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if det == 0.0:
            continue
        first_row = max(0, math.ceil(min(ay, by, cy) - EDGE))
        last_row = min(num_rows - 1, math.floor(max(ay, by, cy) + EDGE))
        first_column = max(0, math.ceil(min(ax, bx, cx) - EDGE))
        last_column = min(num_columns - 1, math.floor(max(ax, bx, cx) + EDGE))
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                px, py = column - ax, row - ay
                b = (px * (cy - ay) - py * (cx - ax)) / det
                c = (py * (bx - ax) - px * (by - ay)) / det
                if b < -EDGE or c < -EDGE or b + c > 1.0 + EDGE:
                    continue
                z = az + b * (bz - az) + c * (cz - az)
                if not z <= top[row, column]:
                    top[row, column] = z
                    taken[row, column] = (1.0 - b - c) * value[f, 0] + b * value[f, 1]
                    taken[row, column] += c * value[f, 2]
                if not z >= bottom[row, column]:
                    bottom[row, column] = z
    return top, bottom, taken
