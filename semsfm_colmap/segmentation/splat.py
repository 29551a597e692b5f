"""The point of a cloud that each pixel of a parallel projection shows: a depth buffer.

The grid has cells of the cloud's spacing, and a point fills the 3 x 3 cells around it, so that the
near side of a surface has no gaps through which its far side would show.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int


def first_points(uv: Float, depth: Float, size: tuple[int, int], cell: float) -> Int:
    """The nearest point in each cell, -1 where there is none: (rows, columns).

    Parameters
    ----------
    uv : (N, 2) px
    depth : (N,) growing away from the viewer
    size : width, height of the image, px
    cell : side of a cell, px; the grid has ``ceil(size / cell)`` of them

    """
    width, height = (int(np.ceil(s / cell)) for s in size)
    order = np.argsort(-depth, kind="stable")
    at = np.floor(uv[order] / cell).astype(np.int64)
    nearest = np.full(width * height, np.inf)
    first = np.full(width * height, -1, dtype=np.int64)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            x, y = at[:, 0] + dx, at[:, 1] + dy
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            where, point = (y * width + x)[inside], order[inside]
            # the last of equal indices stays: the nearest, as they come from far to near
            candidate = np.full(width * height, -1, dtype=np.int64)
            candidate[where] = point
            filled = np.flatnonzero(candidate >= 0)
            nearer = depth[candidate[filled]] < nearest[filled]
            filled = filled[nearer]
            nearest[filled] = depth[candidate[filled]]
            first[filled] = candidate[filled]
    return first.reshape(height, width)
