"""Normals of a point cloud from local planes, their side from the viewers, and stray points.

The normal at a point is the eigenvector of the smallest eigenvalue of the covariance of its k
nearest neighbours (Hoppe et al., SIGGRAPH 1992). Its sign is free; under parallel projection it
is known without ray casting: a point that an image with viewing direction d (from the viewer into
the scene) saw has a normal n with ``n . d < 0``. The mean of d over the seeing images decides, and
where the surface is nearly parallel to d the neighbours are asked.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.types import Bool, Float, Int, Reconstruction

_CHUNK = 50_000
"""Points per batch: bounds the memory of the neighbour tensor to some 100 MB."""
_GRAZING_COSINE = 0.35
"""Below this |n . d| the sign is decided by the neighbours (20 degrees from grazing)."""


def nearest_neighbors(points: Float, num_neighbors: int) -> tuple[Float, Int]:
    """Distances and indices of the k nearest other points: (N, 3) -> (N, k), (N, k)."""
    from scipy.spatial import cKDTree

    k = min(num_neighbors, len(points) - 1)
    distance, idx = cKDTree(points).query(points, k=k + 1, workers=-1)
    return np.asarray(distance)[:, 1:], np.asarray(idx, dtype=np.int64)[:, 1:]


def sampling_distance(points: Float, neighbor: int = 8) -> float:
    """Median distance to the 8th neighbour, the length that all radii are measured in."""
    distance, _ = nearest_neighbors(points, neighbor)
    return float(np.median(distance[:, -1]))


def mean_viewing_direction(reconstruction: Reconstruction) -> Float:
    """Unit mean of the viewing directions of the images that saw each point: (N, 3)."""
    obs = reconstruction.observations.select(reconstruction.inlier)
    directions = reconstruction.cameras.viewing_direction[obs.image_idx]
    total = np.stack(
        [
            np.bincount(obs.track_idx, weights=directions[:, k], minlength=obs.num_tracks)
            for k in range(3)
        ],
        axis=1,
    )
    return _unit(np.asarray(total, dtype=np.float64))


def mean_direction_from(centres: Float, points: Float, image_idx: Int, point_idx: Int) -> Float:
    """Unit mean of the directions from the camera centres to each point that they see.

    Parameters
    ----------
    centres, points : (M, 3), (N, 3)
    image_idx, point_idx : (O,), (O,) who sees what

    Returns
    -------
    (N, 3), zero for points that nobody sees

    """
    ray = _unit(points[point_idx] - centres[image_idx])
    total = [np.bincount(point_idx, weights=ray[:, k], minlength=len(points)) for k in range(3)]
    return _unit(np.stack(total, axis=1))


def estimate_normals(points: Float, viewing_direction: Float, num_neighbors: int = 24) -> Float:
    """Unit normals on the viewer's side of the local planes.

    Parameters
    ----------
    points : (N, 3), N >= 4
    viewing_direction : (N, 3) from the viewer into the scene

    Returns
    -------
    (N, 3) with ``n . d < 0`` wherever the surface is not seen at a grazing angle

    """
    _, idx = nearest_neighbors(points, num_neighbors)
    normals = np.empty_like(points)
    for start in range(0, len(points), _CHUNK):
        rows = slice(start, start + _CHUNK)
        around = points[np.column_stack([np.arange(len(points))[rows], idx[rows]])]
        around = around - around.mean(axis=1, keepdims=True)
        covariance = np.einsum("nki,nkj->nij", around, around)
        normals[rows] = np.linalg.eigh(covariance)[1][:, :, 0]
    return orient_normals(normals, viewing_direction, idx)


def orient_normals(normals: Float, viewing_direction: Float, neighbors: Int) -> Float:
    """Flip normals to the viewer's side; grazing ones follow their neighbours' majority."""
    cosine = np.einsum("ni,ni->n", normals, viewing_direction)
    normals = np.where(cosine[:, None] > 0, -normals, normals)
    grazing = np.flatnonzero(np.abs(cosine) < _GRAZING_COSINE)
    weight = np.abs(cosine)
    around = neighbors[grazing]
    agreement = np.einsum("nki,ni->nk", normals[around], normals[grazing])
    vote = np.einsum("nk,nk->n", agreement, weight[around])
    normals[grazing[vote < 0]] *= -1.0
    return np.asarray(normals)


def statistical_inliers(points: Float, num_neighbors: int, max_sigma: float) -> Bool:
    """Points that are not stray: (N, 3) -> (N,) bool.

    A point is stray when the logarithm of its mean distance to its neighbours lies `max_sigma`
    robust standard deviations above the median (Rusu et al. 2008 with the mean and deviation
    replaced by median and 1.4826 MAD, which outliers do not inflate).
    """
    if len(points) <= num_neighbors:
        return np.ones(len(points), dtype=bool)
    distance, _ = nearest_neighbors(points, num_neighbors)
    log_mean = np.log(np.maximum(distance.mean(axis=1), np.finfo(float).tiny))
    median = np.median(log_mean)
    sigma = MAD_TO_SIGMA * np.median(np.abs(log_mean - median))
    return np.asarray(log_mean <= median + max_sigma * max(float(sigma), 1e-3))


def _unit(v: Float) -> Float:
    norm = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(norm > 0, norm, 1.0))
