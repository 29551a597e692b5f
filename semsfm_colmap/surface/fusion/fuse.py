"""Depth maps to one cloud: what several maps agree on, averaged, one point per grid cell.

Each pixel asks the other maps (`consistency.py`). It becomes a point when enough agree and fewer
contradict; the point moves along its normal to the weighted mean of what they say. Points fall into
the cells of a grid whose size is the wanted spacing; a cell keeps the weighted mean. Maps are read
one reference at a time and the grid is merged as it fills, so memory does not grow with the number
of images.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import statistical_inliers
from semsfm_colmap.surface.depth_geometry import back_project, depth_map_unit, planes_and_normals
from semsfm_colmap.surface.fusion.cloud import dominant_layer, select, smooth_along_normals
from semsfm_colmap.surface.fusion.consistency import vote
from semsfm_colmap.surface.fusion.error_bars import matching_variance, with_error_bars
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.rasters import raster_reader
from semsfm_colmap.surface.stereo.views import choose_neighbors
from semsfm_colmap.types import (
    Array,
    Bool,
    DepthMap,
    Float,
    Int,
    OrthographicCameras,
    PointCloud,
    Reconstruction,
)

Progress = Callable[[int, int], None]
"""Called with the number done and the total."""

_NUM_CACHED = 24
"""Depth maps kept in memory at a time."""
_MERGE_ROWS = 2_000_000
"""Points gathered before they are merged into the grid: some 200 MB."""
_MAX_SLANT_DEG = 75.0
"""Steeper surface is left to images that see it better."""
_MIN_FRONTALITY = 0.7
"""A map leaves a pixel to the others when one of them sees its surface this much more frontally."""


def fuse(
    depth_maps: Sequence[DepthMap],
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
    *,
    progress: Progress | None = None,
) -> PointCloud:
    """The points that depth maps agree on, with normals, grey values and deviations.

    Parameters
    ----------
    depth_maps : in any order; a lazy sequence (`files.DepthMapFolder`) is read piece by piece
    reconstruction : the cameras
    image_path : folder of the prepared images, for the grey values
    options : tolerances, spacing
    progress : called after each depth map

    Returns
    -------
    PointCloud, empty when the maps agree nowhere. ``sigma`` is the standard deviation along the
    normal, with all that `error_bars.py` lists.

    """
    names = list(reconstruction.image_names)
    map_names = _names(depth_maps)
    position = {names.index(name): k for k, name in enumerate(map_names)}
    images = np.array(sorted(position), dtype=np.int64)
    required = min(options.min_consistent_maps, max(1, len(images) - 1))
    load = lru_cache(maxsize=_NUM_CACHED)(lambda idx: depth_maps[position[idx]])
    grid: _Grid | None = None
    for done, image_idx in enumerate(images.tolist()):
        depth_map = load(image_idx)
        size = reconstruction.image_size_px[image_idx]
        unit = depth_map_unit(reconstruction.cameras, image_idx, size, depth_map)
        if grid is None:
            grid = _Grid(options.spacing_px * unit)
        read = raster_reader(
            Path(image_path),
            None,
            reconstruction.image_names,
            reconstruction.image_size_px,
            max(depth_map.depth.shape),
            1,
            reconstruction.drift_px,
        )
        rows = _points(
            depth_map,
            image_idx,
            images,
            load,
            reconstruction,
            read(image_idx).grey,
            required,
            options,
        )
        grid.add(rows)
        if progress is not None:
            progress(done + 1, len(images))
    if grid is None:
        raise InputError("There are no depth maps to fuse: run the densify step first.")
    return with_error_bars(_clean(*grid.cloud(), grid.size, options), reconstruction, grid.size)


def _names(depth_maps: Sequence[DepthMap]) -> list[str]:
    names = getattr(depth_maps, "image_names", None)
    return list(names) if names is not None else [d.image_name for d in depth_maps]


def _points(
    depth_map: DepthMap,
    image_idx: int,
    images: Int,
    load: Callable[[int], DepthMap],
    reconstruction: Reconstruction,
    grey: Array,
    required: int,
    options: SurfaceOptions,
) -> Float:
    """Rows (weight, position, normal, grey, variance) of one map's accepted pixels: (n, 9)."""
    cameras = reconstruction.cameras
    sizes = reconstruction.image_size_px
    _, normals = planes_and_normals(
        cameras, image_idx, sizes[image_idx], depth_map, options.slope_radius_px
    )
    confidence = depth_map.confidence
    if confidence is None:
        confidence = np.isfinite(depth_map.depth).astype(np.float32)
    scaling = np.array(depth_map.depth.shape[::-1]) / sizes[image_idx]
    others = _others(cameras, image_idx, images, options)
    votes = vote(depth_map, normals, image_idx, others, load, cameras, sizes, options)

    cosine = -normals[2]
    keep = np.isfinite(depth_map.depth) & (votes.agreeing >= required)
    keep &= (votes.contradicting < votes.agreeing) & (cosine >= np.cos(np.radians(_MAX_SLANT_DEG)))
    keep &= cosine >= _MIN_FRONTALITY * votes.best_cosine
    y, x = np.nonzero(keep)
    own = np.maximum(confidence[keep], 1e-3) * cosine[keep]
    total = own + votes.weight[keep]
    share = votes.weight[keep] / total
    points = back_project(cameras, image_idx, scaling, x, y, depth_map.depth[keep].astype(float))
    normal = normals[:, keep].T @ cameras.cam_from_world[image_idx]
    points += (share * votes.offset[keep])[:, None] * normal
    # mean squared distance of all maps, this one included, to their mean
    spread2 = share * (votes.spread[keep] ** 2 + (1.0 - share) * votes.offset[keep] ** 2)
    window = None if depth_map.sigma is None else depth_map.sigma[keep] * cosine[keep]
    variance = matching_variance(np.sqrt(spread2), window, votes.agreeing[keep] + 1.0)
    return np.column_stack([total, points, normal, grey[keep], variance])


def _others(
    cameras: OrthographicCameras, image_idx: int, images: Int, options: SurfaceOptions
) -> Int:
    """The maps to ask about one map's pixels: spread around it, up to a wide angle."""
    among = np.concatenate([[image_idx], images[images != image_idx]])
    chosen = choose_neighbors(
        cameras.select(among),
        0,
        num=options.num_fusion_neighbors,
        min_angle_rad=1e-6,
        max_angle_rad=np.radians(options.max_fusion_angle_deg),
    )
    return np.asarray(among[chosen])


class _Grid:
    """Weighted sums of the rows that fall into each cell."""

    def __init__(self, size: float) -> None:
        self.size = size
        self._waiting: list[Float] = []
        self._num_waiting = 0
        self._key = np.zeros(0, dtype=np.int64)
        self._sums = np.zeros((0, 9))

    def add(self, rows: Float) -> None:
        """Add rows (weight, position, normal, grey, variance)."""
        self._waiting.append(np.column_stack([rows[:, :1], rows[:, 1:] * rows[:, :1]]))
        self._num_waiting += len(rows)
        if self._num_waiting > _MERGE_ROWS:
            self._merge()

    def _merge(self) -> None:
        rows = np.concatenate(self._waiting)
        cell = np.floor(rows[:, 1:4] / rows[:, :1] / self.size).astype(np.int64) + (1 << 20)
        if len(cell) and (cell.min() < 0 or cell.max() >= 1 << 21):
            raise InputError("The depth maps spread too far: the cameras do not fit together.")
        key = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
        key = np.concatenate([self._key, key])
        rows = np.concatenate([self._sums, rows])
        self._key, inverse = np.unique(key, return_inverse=True)
        self._sums = np.stack(
            [np.bincount(inverse, weights=column, minlength=len(self._key)) for column in rows.T],
            axis=1,
        )
        self._waiting, self._num_waiting = [], 0

    def cloud(self) -> tuple[PointCloud, Float]:
        """The weighted mean of each cell, and its weight."""
        if self._waiting:
            self._merge()
        mean = self._sums[:, 1:] / np.maximum(self._sums[:, :1], 1e-300)
        normals = mean[:, 3:6]
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        grey = np.clip(np.rint(mean[:, 6:7]), 0, 255).astype(np.uint8)
        cloud = PointCloud(
            points=mean[:, :3],
            normals=normals,
            colors=np.repeat(grey, 3, axis=1),
            sigma=np.sqrt(mean[:, 7]),
        )
        return cloud, self._sums[:, 0]


def _clean(cloud: PointCloud, weight: Float, size: float, options: SurfaceOptions) -> PointCloud:
    """One layer of points without stray ones and small islands, lightly smoothed."""
    if len(cloud.points) <= options.num_outlier_neighbors:
        return cloud
    cloud = select(cloud, dominant_layer(cloud, weight, size))
    cloud = select(
        cloud,
        statistical_inliers(cloud.points, options.num_outlier_neighbors, options.max_outlier_sigma),
    )
    cloud = select(cloud, _large_islands(cloud.points, 2.5 * size, options.min_component_fraction))
    return smooth_along_normals(cloud, options.num_normal_neighbors // 2, 1)


def _large_islands(points: Float, radius: float, min_fraction: float) -> Bool:
    """Points in clusters that hold at least a share of the largest cluster's points."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    from semsfm_colmap.geometry.normals import nearest_neighbors

    distance, idx = nearest_neighbors(points, 8)
    row = np.repeat(np.arange(len(points)), idx.shape[1])
    near = distance.reshape(-1) <= radius
    graph = coo_array(
        (np.ones(near.sum(), dtype=np.int8), (row[near], idx.reshape(-1)[near])),
        shape=(len(points), len(points)),
    )
    _, label = connected_components(graph, directed=False)
    size = np.bincount(label)
    return np.asarray(size[label] >= min_fraction * size.max())
