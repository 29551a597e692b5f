"""How rough a cloud is around each of its points."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.normals import nearest_neighbors
from semsfm_colmap.types import Float

_CHUNK = 40_000
"""Points a batch: bounds the memory."""


def surface_variation(points: Float, normals: Float, num_neighbors: int) -> Float:
    """Share of the variance of a neighbourhood that lies across its plane: (N,) in 0 to 1/3.

    ``l_0 / (l_0 + l_1 + l_2)`` of the eigenvalues of the covariance of the neighbours [Pauly,
    Gross, Kobbelt, IEEE Visualization 2002]; 0 on a plane. Neighbours with opposite normals lie
    on the other side of something thin and do not count.
    """
    out = np.zeros(len(points))
    _, idx = nearest_neighbors(points, num_neighbors)
    for start in range(0, len(points), _CHUNK):
        rows = slice(start, start + _CHUNK)
        near = points[idx[rows]] - points[rows, None]
        weight = (np.einsum("nki,ni->nk", normals[idx[rows]], normals[rows]) > 0).astype(float)
        total = np.maximum(weight.sum(axis=1), 1.0)
        near = near - (np.einsum("nk,nki->ni", weight, near) / total[:, None])[:, None]
        covariance = np.einsum("nk,nki,nkj->nij", weight, near, near)
        values = np.linalg.eigvalsh(covariance)
        out[rows] = values[:, 0] / np.maximum(values.sum(axis=1), 1e-300)
    return np.maximum(out, 0.0)
