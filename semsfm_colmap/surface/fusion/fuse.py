"""Depth maps to one cloud: what several maps agree on, averaged, one point per grid cell.

Each pixel asks the other maps (`consistency.py`). It becomes a point when enough agree and fewer
contradict; the point moves along its normal to the weighted mean of what they say. Points fall into
the cells of a grid whose size is the wanted spacing; a cell keeps the weighted mean. Maps are read
one reference at a time and the grid is merged as it fills, so memory does not grow with the number
of images.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import statistical_inliers
from semsfm_colmap.surface.depth_geometry import back_project, depth_map_unit, planes_and_normals
from semsfm_colmap.surface.fusion.cloud import dominant_layer, smooth_along_normals
from semsfm_colmap.surface.fusion.consistency import vote
from semsfm_colmap.surface.fusion.error_bars import matching_variance, with_error_bars
from semsfm_colmap.surface.fusion.grid import CloudGrid
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.rasters import read_raster
from semsfm_colmap.surface.stereo.undrift import drift_of
from semsfm_colmap.surface.stereo.views import choose_neighbors
from semsfm_colmap.types import (
    Array,
    Bool,
    DepthMap,
    Float,
    Int,
    OrthographicCameras,
    ParallelMap,
    PointCloud,
    Reconstruction,
)

Progress = Callable[[int, int], None]
"""Called with the number done and the total."""

_NUM_CACHED = 24
"""Depth maps kept in memory at a time."""
_MAX_SLANT_DEG = 75.0
"""Steeper surface is left to images that see it better."""
_MIN_FRONTALITY = 0.4
"""A map leaves a pixel to the others when one of them sees its surface this much more frontally."""
_MAX_WINDOW_SIGMA = 10.0
"""In units of the tolerance of agreement: windows that say nothing leave what the maps say."""


def fuse(
    depth_maps: Sequence[DepthMap],
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
    *,
    progress: Progress | None = None,
    parallel_map: ParallelMap = map,
) -> PointCloud:
    """The points that depth maps agree on, with normals, grey values and deviations.

    Parameters
    ----------
    depth_maps : in any order; a lazy sequence (`files.DepthMapFolder`) is read piece by piece
    reconstruction : the cameras
    image_path : folder of the prepared images, for the grey values
    options : tolerances, spacing
    progress : called after each depth map
    parallel_map : over the depth maps

    Returns
    -------
    PointCloud, empty when the maps agree nowhere. ``sigma`` is the standard deviation along the
    normal, with all that `error_bars.py` lists.

    """
    fused = gathered(
        depth_maps,
        reconstruction,
        image_path,
        options,
        progress=progress,
        parallel_map=parallel_map,
    )
    return with_error_bars(_clean(fused, options), reconstruction, fused.spacing)


@dataclass(frozen=True, kw_only=True, eq=False)
class Gathered:
    """What the depth maps agree on, before it is cleaned."""

    cloud: PointCloud
    weight: Float
    """(N,) of each point, the sum over the pixels that made it"""
    spacing: float
    """Size of the cells, world units"""


def gathered(
    depth_maps: Sequence[DepthMap],
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
    *,
    progress: Progress | None = None,
    parallel_map: ParallelMap = map,
) -> Gathered:
    """The points that depth maps agree on, one a cell of the grid; parameters as of `fuse`."""
    names = list(reconstruction.image_names)
    map_names = _names(depth_maps)
    position = {names.index(name): k for k, name in enumerate(map_names)}
    images = np.array(sorted(position), dtype=np.int64)
    if len(images) == 0:
        raise InputError("There are no depth maps to fuse: run the densify step first.")
    job = _Job(depth_maps, position, reconstruction, Path(image_path), options)
    first = int(images[0])
    size = reconstruction.image_size_px[first]
    unit = depth_map_unit(reconstruction.cameras, first, size, job.load(first))
    grid = CloudGrid(options.spacing_px * unit)
    for done, rows in enumerate(parallel_map(job, images.tolist())):
        grid.add(rows)
        if progress is not None:
            progress(done + 1, len(images))
    cloud, weight = grid.cloud()
    return Gathered(cloud=cloud, weight=weight, spacing=grid.size)


class _Job:
    """The accepted points of one map after another.

    Pickled for another process it reads its maps there, where they are those of a folder.
    """

    def __init__(
        self,
        depth_maps: Sequence[DepthMap],
        position: dict[int, int],
        reconstruction: Reconstruction,
        image_path: Path,
        options: SurfaceOptions,
    ) -> None:
        self.given = depth_maps, position, reconstruction, image_path, options
        self.images = np.array(sorted(position), dtype=np.int64)
        self.required = min(options.min_consistent_maps, max(1, len(position) - 1))
        self.load = lru_cache(maxsize=_NUM_CACHED)(lambda idx: depth_maps[position[idx]])

    def __reduce__(self) -> tuple[object, ...]:
        return _Job, self.given

    def __call__(self, image_idx: int) -> Float:
        _, _, reconstruction, image_path, options = self.given
        depth_map = self.load(image_idx)
        width, height = (int(v) for v in reconstruction.image_size_px[image_idx])
        name = reconstruction.image_names[image_idx]
        longest = max(depth_map.depth.shape)
        drift = drift_of(reconstruction.drift_px, image_idx)
        grey = read_raster(image_path, None, name, longest, (width, height), drift).grey
        return _points(
            depth_map,
            image_idx,
            self.images,
            self.load,
            reconstruction,
            grey,
            self.required,
            options,
        )


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
    # what no other map can judge stands on the neighbours that its own windows correlate with
    alone = (votes.agreeing == 0) & (votes.contradicting == 0)
    alone &= confidence >= options.min_lone_confidence
    keep = np.isfinite(depth_map.depth) & ((votes.agreeing >= required) | alone)
    keep &= ((votes.contradicting < votes.agreeing) | alone) & (
        cosine >= np.cos(np.radians(_MAX_SLANT_DEG))
    )
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
    unit = depth_map_unit(cameras, image_idx, sizes[image_idx], depth_map)
    window = None
    if depth_map.sigma is not None:
        window = np.minimum(
            depth_map.sigma[keep] * cosine[keep], _MAX_WINDOW_SIGMA * options.consistency_px * unit
        )
    variance = matching_variance(np.sqrt(spread2), window, votes.agreeing[keep] + 1.0)
    # nothing is known of a lone depth but that it would have had to agree within the tolerance
    lone = alone[keep]
    variance[lone] = np.maximum(variance[lone], (0.5 * options.consistency_px * unit) ** 2)
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


def _clean(fused: Gathered, options: SurfaceOptions) -> PointCloud:
    """One layer of points without stray ones and small islands, lightly smoothed."""
    cloud, weight, size = fused.cloud, fused.weight, fused.spacing
    if len(cloud.points) <= options.num_outlier_neighbors:
        return cloud
    cloud = cloud.select(dominant_layer(cloud, weight, size))
    cloud = cloud.select(
        statistical_inliers(
            cloud.points, options.num_outlier_neighbors, options.max_fused_outlier_sigma
        )
    )
    least = min(options.min_component_fraction, options.max_crumb_faces / len(cloud.points))
    cloud = cloud.select(_large_islands(cloud.points, 2.5 * size, least))
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
