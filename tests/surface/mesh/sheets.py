"""Sheets of triangles."""

import numpy as np

from semsfm_colmap.types import Float, Int


def grid(n: int) -> tuple[Float, Int]:
    """A flat n x n sheet in z = 0 that faces +z."""
    y, x = np.mgrid[0:n, 0:n].astype(float)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + n])
    upper = np.column_stack([corner + 1, corner + n + 1, corner + n])
    return vertices, np.concatenate([lower, upper])


def up(vertices: Float) -> Float:
    return np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
