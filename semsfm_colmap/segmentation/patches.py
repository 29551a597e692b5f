"""Connected patches of a cloud."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.normals import nearest_neighbors
from semsfm_colmap.types import Bool, Float, Int

MAX_GAP = 3.0
"""Neighbours farther away than this many median distances are not connected."""


def connected_patches(points: Float, chosen: Bool, num_neighbors: int) -> list[Int]:
    """The chosen points in patches connected by nearest neighbours among them, as indices.

    Parameters
    ----------
    points : (N, 3)
    chosen : (N,)
    num_neighbors : that each point is connected with

    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    where = np.flatnonzero(chosen)
    if len(where) <= num_neighbors:
        return [where] if len(where) else []
    distance, idx = nearest_neighbors(points[where], num_neighbors)
    near = distance <= MAX_GAP * np.median(distance[:, -1])
    row = np.repeat(np.arange(len(where)), idx.shape[1])[near.ravel()]
    one = np.ones(len(row), dtype=np.int8)
    graph = coo_array((one, (row, idx[near])), shape=(len(where),) * 2)
    _, number = connected_components(graph, directed=False)
    order = np.argsort(number, kind="stable")
    ends = np.flatnonzero(np.diff(number[order])) + 1
    return [np.asarray(where[rows], dtype=np.int64) for rows in np.split(order, ends)]
