"""Standard deviation of every fused point along its normal.

With all lengths in px of the depth maps, a point that n maps agree on has the variance

    sigma^2 = (K m)^2 + g r^2 + a s^2 + b w^2 / n + c^2.

- w: noise of the matching. Gauss-Newton on normalised windows (`stereo/refine_kernels.py`) leaves a
  depth with the variance ``1 / information``; w is its deviation across the surface. It holds
  image noise, texture and the angles between the views. Neighbouring pixels share most of their
  windows, so that a cell of the grid is credited with no more than one pixel a map.
- s: deviation of the n maps about their mean (`fusion/consistency.py`), which knows of occlusion
  and of wrong matches too. Maps share images, so that their mean is no better by the root of n.
- r: how far the neighbouring points lie off the surface that the normals describe. A window has no
  single depth; where the surface is rough it matters which part of it the window shows.
- m: the median of r over the cloud. A window keeps a fraction of the relief that the specimen has,
  and all maps alike lose the rest: what is left is K times as large. No two surfaces made from the
  same kind of window differ by it, and no residual shows it.
- c: the cameras, from the covariances of the reconstructed points nearby, along the normal, without
  what these points err in by themselves. Systematic parts (docs/truth.md) are in them.

a, b, g and K were fitted to ten rendered series, see docs/surface_sigma.md, which also says what
other series make of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.geometry.normals import (
    estimate_normals,
    mean_viewing_direction,
    nearest_neighbors,
)
from semsfm_colmap.types import Array, Float, PointCloud, Reconstruction

RELIEF_FACTOR = 3.62
"""K"""
SPREAD_SHARE = 0.20
"""a"""
WINDOW_SHARE = 0.11
"""b"""
ROUGHNESS_SHARE = 1.44
"""g"""
ROUGHNESS_SPACINGS = 1.5
"""Reach of the weights of the neighbours that r is taken from."""
NUM_ROUGHNESS_NEIGHBORS = 24
NUM_CAMERA_NEIGHBORS = 12
"""Reconstructed points that tell a place's part of the cameras."""
CAMERA_QUANTILE = 0.25
"""Of their variances: the better they are, the less of their own noise is in them."""
NUM_NORMAL_NEIGHBORS = 30


def matching_variance(spread: Array, window_sigma: Array | None, num_maps: Array) -> Float:
    """The module's ``a s^2 + b w^2 / n``, in the unit of the arguments squared.

    Parameters
    ----------
    spread, window_sigma : s and w of each point; None where no map knows w
    num_maps : n

    """
    variance = SPREAD_SHARE * np.asarray(spread, dtype=np.float64) ** 2
    if window_sigma is not None:
        variance = variance + WINDOW_SHARE * np.square(window_sigma, dtype=np.float64) / num_maps
    return np.asarray(variance)


def with_error_bars(
    cloud: PointCloud, reconstruction: Reconstruction, spacing: float
) -> PointCloud:
    """The cloud with all parts of the variance, where it has that of the matching alone.

    Parameters
    ----------
    cloud : with normals, and ``sigma``, the root of `matching_variance`
    reconstruction : cameras and points, with the points' covariances where they are known
    spacing : between the points of the cloud, world units

    """
    if cloud.sigma is None or cloud.normals is None or len(cloud.points) < 2:
        return cloud
    rough = roughness(cloud, spacing)
    variance = cloud.sigma**2 + ROUGHNESS_SHARE * rough**2
    variance += (RELIEF_FACTOR * float(np.median(rough))) ** 2
    variance += camera_variance(cloud, reconstruction)
    return replace(cloud, sigma=np.sqrt(variance))


def roughness(cloud: PointCloud, spacing: float) -> Float:
    """The module's r: (N,) world units.

    The deviation of ``(p_k - x) . (n + n_k) / 2`` over the neighbours about its mean, weighted by
    ``exp(-d^2 / 2 (1.5 spacing)^2)`` of their distance d. Planes and spheres have none: what is
    round is not rough.
    """
    assert cloud.normals is not None
    num = min(NUM_ROUGHNESS_NEIGHBORS, len(cloud.points) - 1)
    distance, idx = nearest_neighbors(cloud.points, num)
    between = 0.5 * (cloud.normals[idx] + cloud.normals[:, None])
    height = np.einsum("nki,nki->nk", cloud.points[idx] - cloud.points[:, None], between)
    weight = np.exp(-0.5 * (distance / (ROUGHNESS_SPACINGS * spacing)) ** 2)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    mean = (weight * height).sum(axis=1, keepdims=True)
    return np.asarray(np.sqrt((weight * (height - mean) ** 2).sum(axis=1)))


def camera_variance(cloud: PointCloud, reconstruction: Reconstruction) -> Float:
    """The module's ``c^2``: (N,) world units squared, zero where no covariances are known.

    The lower quartile over the nearest reconstructed points of ``n . C n - relief^2 (n . n')^2``,
    n the normal of the dense point, n' that of the reconstructed one.
    """
    from scipy.spatial import cKDTree

    C = reconstruction.point_covariance
    if C is None or len(reconstruction.points) == 0:
        return np.zeros(len(cloud.points))
    known = np.flatnonzero(np.isfinite(C).all(axis=(1, 2)))
    num = min(NUM_CAMERA_NEIGHBORS, len(known))
    if num == 0:
        return np.zeros(len(cloud.points))
    assert cloud.normals is not None
    points = reconstruction.points[known]
    _, idx = cKDTree(points).query(cloud.points, k=num, workers=-1)
    idx = idx.reshape(-1, num)
    variance = np.einsum("ni,nkij,nj->nk", cloud.normals, C[known][idx], cloud.normals)
    if reconstruction.relief_px is not None and len(points) > 3:
        px = 1.0 / float(np.median(reconstruction.cameras.scale_px_per_unit))
        own = estimate_normals(
            points, mean_viewing_direction(reconstruction)[known], NUM_NORMAL_NEIGHBORS
        )
        along = np.einsum("nki,ni->nk", own[idx], cloud.normals)
        variance = variance - (reconstruction.relief_px * px * along) ** 2
    return np.asarray(np.quantile(np.maximum(variance, 0.0), CAMERA_QUANTILE, axis=1))
