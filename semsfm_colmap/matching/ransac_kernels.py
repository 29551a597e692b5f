"""Compiled local optimisation of hyperplanes through contaminated points (see `ransac`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array

DIMENSIONS = 4
MIN_FITTED = 5
"""Fewer points than this do not tell a fit from a coincidence."""


@numba.njit(nogil=True, cache=True)
def distance_to(point: Array, normal: Array, offset: float) -> float:
    """``n . x + e`` of a point (4,)."""
    return (
        normal[0] * point[0]
        + normal[1] * point[1]
        + normal[2] * point[2]
        + normal[3] * point[3]
        + offset
    )


@numba.njit(nogil=True, cache=True)
def optimise_hyperplanes(
    points: Array, normals: Array, offsets: Array, thresholds: Array, limit: float
) -> Array:
    """Fit hyperplanes again and again to the points near them, by least squares.

    The best hyperplane through some points contains their mean m; its normal is the eigenvector of
    ``sum (x - m) (x - m)^T`` with the smallest eigenvalue.

    Parameters
    ----------
    points : (L, 4) with their origin among them
    normals, offsets : (S, 4) of length 1, (S,); changed in place
    thresholds : distances up to which a point is fitted, one after another
    limit : squared distances count up to this

    Returns
    -------
    (S,) sum of the squared distances, each at most `limit`

    """
    score = np.zeros(len(normals))
    for s in range(len(normals)):
        n = normals[s]
        for threshold in thresholds:
            count = 0
            mean = np.zeros(DIMENSIONS)
            scatter = np.zeros((DIMENSIONS, DIMENSIONS))
            for k in range(len(points)):
                x = points[k]
                if abs(distance_to(x, n, offsets[s])) < threshold:
                    count += 1
                    for a in range(DIMENSIONS):
                        mean[a] += x[a]
                        for b in range(a + 1):
                            scatter[a, b] += x[a] * x[b]
            if count < MIN_FITTED:
                break
            mean /= count
            for a in range(DIMENSIONS):
                for b in range(a + 1):
                    scatter[a, b] -= count * mean[a] * mean[b]
                    scatter[b, a] = scatter[a, b]
            n[:] = np.linalg.eigh(scatter)[1][:, 0]
            offsets[s] = -np.sum(n * mean)
        for k in range(len(points)):
            score[s] += min(distance_to(points[k], n, offsets[s]) ** 2, limit)
    return score
