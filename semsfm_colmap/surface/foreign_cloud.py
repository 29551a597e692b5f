"""Oriented clouds from what other programs left: sparse points, a fused cloud, depth maps.

The side of a normal comes from visibility: a point that was seen along d has a normal n with
``n . d < 0``. Dense points without normals take d from the sparse point nearest to them.

Depth maps of patch-match stereo agree or do not; a pixel counts when some other maps have the
surface within a tolerance of its point. The tolerance is in px of the map, since what a map can
tell is proportional to the size of its pixels there, under any projection.

Error bars are what the source tells: for sparse points the covariance of the triangulation, for
depth maps the spread of those that agree (`with_spread`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import estimate_normals, statistical_inliers
from semsfm_colmap.surface.depth_view import DepthView, seen_by
from semsfm_colmap.surface.fusion.cloud import MIN_CLOUD_POINTS, deviation_along, thin
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Bool, Float, Int, PointCloud

MIN_CONSISTENT_SHARE = 0.5
"""Where there are few maps, no more than this share of the others has to agree."""


MAX_SLANT_DEG = 75.0
"""Maps that see the surface more slanted have no say in its error bars."""


def viewed_cloud(
    points: Float,
    directions: Float,
    colors: Array | None,
    options: SurfaceOptions,
    covariance: Float | None = None,
) -> PointCloud:
    """Points with normals toward their viewers, without stray ones.

    Parameters
    ----------
    points : (N, 3)
    directions : (N, 3) from the viewers into the scene
    colors : (N, 3) uint8 or None
    covariance : (N, 3, 3), from which ``sigma`` along the normals is made

    """
    keep: Bool = np.asarray(np.isfinite(points).all(axis=1))
    if keep.sum() < MIN_CLOUD_POINTS:
        raise InputError(
            f"Only {int(keep.sum())} points are seen often enough, too few for a surface (at least "
            f"{MIN_CLOUD_POINTS}): match more images, or lower --surface.min_track_length."
        )
    rows = np.flatnonzero(keep)
    rows = rows[
        statistical_inliers(points[rows], options.num_outlier_neighbors, options.max_outlier_sigma)
    ]
    normals = estimate_normals(points[rows], directions[rows], options.num_normal_neighbors)
    return PointCloud(
        points=points[rows],
        normals=normals,
        colors=None if colors is None else colors[rows],
        sigma=None if covariance is None else deviation_along(normals, covariance[rows]),
    )


def orient_cloud(
    cloud: PointCloud, sparse_points: Float, sparse_directions: Float, options: SurfaceOptions
) -> PointCloud:
    """A dense cloud with normals: its own, or estimated and turned to who sees the sparse points.

    Parameters
    ----------
    cloud : N points
    sparse_points, sparse_directions : (S, 3), (S, 3) where points were seen from

    """
    keep: Bool = np.asarray(np.isfinite(cloud.points).all(axis=1))
    if cloud.normals is not None:
        length = np.linalg.norm(cloud.normals, axis=1)
        keep &= np.isfinite(length) & (length > 0)
        if keep.any():
            cloud = cloud.select(keep)
            assert cloud.normals is not None
            unit = cloud.normals / np.linalg.norm(cloud.normals, axis=1, keepdims=True)
            return replace(cloud, normals=unit)
        keep = np.asarray(np.isfinite(cloud.points).all(axis=1))
    if len(sparse_points) == 0:
        raise InputError(
            "The cloud has no normals and the model no points that tell who saw it: give a cloud "
            "with normals, or a model with points."
        )
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(sparse_points).query(cloud.points[keep], workers=-1)
    colors = None if cloud.colors is None else cloud.colors[keep]
    return viewed_cloud(cloud.points[keep], sparse_directions[nearest], colors, options)


def cloud_of_views(views: Sequence[DepthView], options: SurfaceOptions) -> PointCloud:
    """The points of depth maps that other maps agree with, merged to a spacing of some px.

    Raises
    ------
    InputError
        The maps agree on too little.

    """
    needed = min(options.min_consistent_maps, int(np.ceil(MIN_CONSISTENT_SHARE * (len(views) - 1))))
    parts: list[PointCloud] = []
    sizes: list[float] = []
    for i, view in enumerate(views):
        row, col = view.pixels()
        if len(row) == 0:
            continue
        points = view.points(row, col)
        tolerance = options.consistency_px * view.pixel_size(points)
        count: Int = np.zeros(len(points), dtype=np.int64)
        for j in nearest_views(views, i, options.num_fusion_neighbors):
            count += seen_by(views[j], points, tolerance)
        keep = count >= needed
        normals = normals_of_view(view, points, row, col)
        keep &= np.isfinite(normals).all(axis=1)
        if not keep.any():
            continue
        colors = None if view.colors is None else view.colors[row[keep], col[keep]]
        parts.append(PointCloud(points=points[keep], normals=normals[keep], colors=colors))
        sizes.append(float(np.median(tolerance)) / options.consistency_px)
    num = sum(len(part.points) for part in parts)
    if num < MIN_CLOUD_POINTS:
        raise InputError(
            f"The {len(views)} depth maps agree on {num} points, too few for a surface: make them "
            "with more images or at a higher resolution, or leave them out."
        )
    has_colors = all(part.colors is not None for part in parts)
    cloud = PointCloud(
        points=np.concatenate([part.points for part in parts]),
        normals=np.concatenate([part.normals for part in parts if part.normals is not None]),
        colors=np.concatenate([part.colors for part in parts if part.colors is not None])
        if has_colors
        else None,
    )
    cloud = thin(cloud, options.spacing_px * float(np.median(sizes)))
    cloud = cloud.select(
        statistical_inliers(cloud.points, options.num_outlier_neighbors, options.max_outlier_sigma)
    )
    return with_spread(cloud, views, options)


def with_spread(
    cloud: PointCloud, views: Sequence[DepthView], options: SurfaceOptions
) -> PointCloud:
    """A cloud whose ``sigma`` is the deviation of the depth maps that agree with each point.

    A map whose pixel there is the point y has its surface ``o = n . (y - x)`` off along the normal
    n of a point x. Over the K maps within the tolerance ``sigma^2 = sum o^2 / (K - 1)``. Where no
    two maps agree nothing is known but that they would have had to: sigma is half the tolerance.
    What all maps err in alike is not in it.

    Parameters
    ----------
    cloud : N points with normals
    views : depth maps of the same surface

    """
    assert cloud.normals is not None
    num: Int = np.zeros(len(cloud.points), dtype=np.int64)
    squared, tolerance = np.zeros(len(num)), np.full(len(num), np.inf)
    for view in views:
        u, v, z = view.project(cloud.points)
        cosine = np.einsum("ni,ni->n", cloud.normals, view.rays(cloud.points))
        width = options.consistency_px * view.pixel_size(cloud.points)
        with np.errstate(invalid="ignore"):
            agree = np.abs(view.depth_at(u, v) - z) <= width
        agree &= cosine < -np.cos(np.radians(MAX_SLANT_DEG))
        there = view.points(v[agree].astype(np.int64), u[agree].astype(np.int64))
        off = np.einsum("ni,ni->n", cloud.normals[agree], there - cloud.points[agree])
        num[agree] += 1
        squared[agree] += off**2
        tolerance[agree] = np.minimum(tolerance[agree], width[agree])
    # what no map shows is as uncertain as the least certain of the others
    known = np.isfinite(tolerance)
    tolerance[~known] = tolerance[known].max(initial=0.0)
    alone = 0.5 * tolerance
    sigma = np.where(num < 2, alone, np.sqrt(squared / np.maximum(num - 1, 1)))
    return replace(cloud, sigma=sigma) if known.any() else cloud


def nearest_views(views: Sequence[DepthView], reference: int, num: int) -> Int:
    """The views whose axes turn the least away from one's own, nearest first: (K,)."""
    axes = np.array([view.depth_row[:3] / np.linalg.norm(view.depth_row[:3]) for view in views])
    order = np.argsort(-(axes @ axes[reference]), kind="stable")
    return order[order != reference][:num]


def normals_of_view(view: DepthView, points: Float, row: Int, col: Int) -> Float:
    """Unit normals toward the viewer of a view's pixels, its own or of their neighbours' plane."""
    rays = view.rays(points)
    if view.normals is not None:
        normals = view.normals[row, col].astype(np.float64)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals = normals / length
        away = np.einsum("ni,ni->n", normals, rays) > 0
        return np.where(away[:, None], np.nan, normals)
    if len(points) < MIN_CLOUD_POINTS:
        return np.full_like(points, np.nan)
    return estimate_normals(points, rays)
