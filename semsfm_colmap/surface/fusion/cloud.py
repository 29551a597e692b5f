"""The sparse points as an oriented cloud; merging points on a grid; smoothing along normals."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import (
    estimate_normals,
    mean_viewing_direction,
    nearest_neighbors,
    statistical_inliers,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Bool, Float, Int, PointCloud, Reconstruction

MIN_CLOUD_POINTS = 20
"""Below this no plane fit, let alone a surface, means anything."""
_LAYER_WIDTH = 1.2
"""Points closer than this many spacings, seen along the normal, compete for one place."""
_LAYER_DEPTH = 4.0
"""Layers farther apart than this many spacings are different surfaces."""


def sparse_cloud(reconstruction: Reconstruction, options: SurfaceOptions) -> PointCloud:
    """The reconstructed points with normals toward the viewers, without stray points.

    ``sigma`` is the standard deviation along the normal, where a covariance is known.
    """
    keep = reconstruction.track_length() >= options.min_track_length
    keep &= np.isfinite(reconstruction.points).all(axis=1)
    if keep.sum() < MIN_CLOUD_POINTS:
        raise InputError(
            f"Only {int(keep.sum())} points are seen in {options.min_track_length} or more images, "
            f"too few for a surface: match more images, or lower surface.min_track_length."
        )
    idx = np.flatnonzero(keep)
    idx = idx[
        statistical_inliers(
            reconstruction.points[idx], options.num_outlier_neighbors, options.max_outlier_sigma
        )
    ]
    points = np.array(reconstruction.points[idx])
    direction = mean_viewing_direction(reconstruction)[idx]
    normals = estimate_normals(points, direction, options.num_normal_neighbors)
    covariance = reconstruction.point_covariance
    color = reconstruction.point_color
    return PointCloud(
        points=points,
        normals=normals,
        colors=None if color is None else np.asarray(color[idx], dtype=np.uint8),
        sigma=None if covariance is None else deviation_along(normals, covariance[idx]),
    )


def deviation_along(normals: Float, covariance: Float) -> Float:
    """Standard deviation of points along their normals: (N, 3), (N, 3, 3) -> (N,)."""
    return np.sqrt(np.einsum("ni,nij,nj->n", normals, covariance, normals))


def voxel_groups(points: Float, size: float) -> tuple[Int, int]:
    """The occupied cell of each point on a grid: (N,) cell numbers from 0, and their count."""
    cell = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    extent = cell.max(axis=0) + 1
    key = (cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2]
    unique, group = np.unique(key, return_inverse=True)
    return np.asarray(group, dtype=np.int64).reshape(-1), len(unique)


def thin(cloud: PointCloud, size: float) -> PointCloud:
    """One point per grid cell: the mean of position, normal and colour of the points in it.

    ``sigma`` becomes the root mean square: the errors of neighbouring points are correlated, so
    averaging is not credited with a gain.
    """
    if len(cloud.points) == 0 or size <= 0:
        return cloud
    group, num = voxel_groups(cloud.points, size)
    count = np.bincount(group, minlength=num)[:, None]

    def mean(values: Array) -> Float:
        columns = [np.bincount(group, weights=c, minlength=num) for c in values.T.astype(float)]
        return np.asarray(np.stack(columns, axis=1) / count)

    normals = None
    if cloud.normals is not None:
        normals = mean(cloud.normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return PointCloud(
        points=mean(cloud.points),
        normals=normals,
        colors=None
        if cloud.colors is None
        else np.clip(np.rint(mean(cloud.colors)), 0, 255).astype(np.uint8),
        sigma=None if cloud.sigma is None else np.sqrt(mean(cloud.sigma[:, None] ** 2)[:, 0]),
    )


def smooth_along_normals(cloud: PointCloud, num_neighbors: int, num_iterations: int) -> PointCloud:
    """Move each point along its normal onto the surface of its neighbours.

    ``x <- x + n sum_k w_k (p_k - x) . (n + n_k) / 2 / sum_k w_k`` with ``w_k = exp(-r_k^2 / 2 h^2)
    max(0, n . n_k)^2``, h half the distance to the farthest neighbour. The mean of the two normals
    makes the offset vanish on a sphere, where ``n`` alone would shrink the surface by its
    curvature. The other side of a thin sheet, whose normals point the other way, has no say.
    Points do not slide along the surface.
    """
    if cloud.normals is None or num_iterations <= 0 or len(cloud.points) <= num_neighbors:
        return cloud
    points, normals = np.array(cloud.points), np.array(cloud.normals)
    for _ in range(num_iterations):
        distance, idx = nearest_neighbors(points, num_neighbors)
        h = 0.5 * distance[:, -1:] + 1e-300
        agreement = np.maximum(np.einsum("nki,ni->nk", normals[idx], normals), 0.0)
        weight = np.exp(-0.5 * (distance / h) ** 2) * agreement**2
        between = 0.5 * (normals[idx] + normals[:, None])
        offset = np.einsum("nki,nki->nk", points[idx] - points[:, None], between)
        total = weight.sum(axis=1) + 1.0
        step = (weight * offset).sum(axis=1) / total
        mean_normal = np.einsum("nk,nki->ni", weight, normals[idx]) + normals
        points += step[:, None] * normals
        normals = mean_normal / np.linalg.norm(mean_normal, axis=1, keepdims=True)
    return PointCloud(points=points, normals=normals, colors=cloud.colors, sigma=cloud.sigma)


def dominant_layer(cloud: PointCloud, weight: Float, spacing: float) -> Bool:
    """Points that no much heavier point above or below them, along the normal, outweighs.

    Depth maps that agree within a tolerance, but not well, leave a second sheet of points beside
    the surface. Of two points on one normal the one with less than half the other's weight goes;
    points whose normals differ by more than a right angle are two sides of something thin and
    do not compete.

    Parameters
    ----------
    cloud : N points with normals
    weight : (N,)
    spacing : world units

    Returns
    -------
    (N,) bool

    """
    assert cloud.normals is not None
    points, normals = cloud.points, cloud.normals
    keep = np.ones(len(points), dtype=bool)
    distance, idx = nearest_neighbors(points, 24)
    for k in range(idx.shape[1]):
        other = idx[:, k]
        gap = points[other] - points
        along = np.einsum("ni,ni->n", gap, normals)
        across = np.sqrt(np.maximum(distance[:, k] ** 2 - along**2, 0.0))
        same_side = np.einsum("ni,ni->n", normals[other], normals) > 0
        rival = (across < _LAYER_WIDTH * spacing) & (np.abs(along) > 0.5 * spacing)
        rival &= (np.abs(along) < _LAYER_DEPTH * spacing) & same_side
        keep &= ~(rival & (weight < 0.5 * weight[other]))
    return keep
