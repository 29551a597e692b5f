"""A truncated signed distance on a grid of voxels, and the surface where it is zero.

With depth maps (Curless and Levoy, SIGGRAPH 1996) a voxel x that a map sees at depth z, where the
map has the surface at z_s, is ``(z_s - z) |n . r| / (a . r)`` in front of it: r is the ray, a the
camera's axis, n the normal of the nearest point of the cloud, so that distances along slanted rays
count as distances to the surface. Voxels more than the truncation behind are hidden and not
counted. Values are averaged with weights |n . r|. It holds for parallel rays as for pinholes
(`depth_view.py`); open3d's integration, which models pinholes alone, is not used.

Without depth maps (Hoppe et al., SIGGRAPH 1992) the distance is the weighted mean of
``n_k . (x - p_k)`` over the nearest points p_k, with weights ``exp(-2 |x - p_k|^2 / b^2)``.

Only voxels within the truncation of a point have a value: what nobody saw stays open. Marching
cubes (Lewiner et al. 2003) puts a vertex on each edge of the grid where the sign changes; values
nearer to zero than a twentieth of a voxel are moved away from it, as they would give needles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.extras import import_extra
from semsfm_colmap.surface.depth_view import DepthView
from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Bool, Float, Int

MAX_VOXELS = 60_000_000
"""Of the box around the points; beyond it voxels become larger: two arrays of 240 MB."""
MIN_VALUE = 0.05
"""Least distance of a voxel's centre to the surface, in voxels."""
MAX_BESIDE = 1.0
"""A voxel that lies farther beside the nearest point, along the surface, than so many b has no
value: the surface would go on beyond its rim."""
NUM_NEIGHBORS = 12
"""Points that a distance without depth maps is the mean of."""
_CHUNK = 200_000
"""Voxels at a time: bounds the memory of the neighbours to some 100 MB."""


def make_surface(task: MeshTask, options: SurfaceOptions) -> RawSurface:
    """The zero of the signed distance, facing the viewers."""
    from scipy.spatial import cKDTree

    measure = import_extra("skimage.measure", "mesh")

    points = task.cloud.points
    voxel = options.tsdf_voxel_factor * task.spacing
    margin = options.tsdf_truncation_voxels + 2.0
    extent = np.ptp(points, axis=0)
    while np.prod(extent / voxel + 2 * margin + 1) > MAX_VOXELS:
        voxel *= 1.1
    truncation = options.tsdf_truncation_voxels * voxel
    origin = points.min(axis=0) - margin * voxel
    shape = tuple((np.ceil(extent / voxel + 2 * margin) + 1).astype(int).tolist())
    cells = np.argwhere(near_points(points, origin, voxel, shape, options.tsdf_truncation_voxels))
    tree = cKDTree(points)
    views = list(task.views)  # read once: 3 MB each
    value = np.full(len(cells), np.nan)
    for start in range(0, len(cells), _CHUNK):
        rows = slice(start, start + _CHUNK)
        x = origin + voxel * cells[rows]
        distance, idx = map(np.asarray, tree.query(x, k=NUM_NEIGHBORS, workers=-1))
        found = distance_to_points(x, task, distance, idx)
        beside = np.sqrt(np.maximum(distance[:, 0] ** 2 - found**2, 0.0))
        near = (distance[:, 0] <= truncation) & (beside <= MAX_BESIDE * task.spacing)
        if views:
            seen = distance_to_maps(x[near], task, views, idx[near, 0], truncation)
            found[near] = np.where(np.isfinite(seen), seen, found[near])
        value[rows] = np.where(near, found, np.nan)
    known = np.isfinite(value)
    scaled = np.clip(value[known] / voxel, -options.tsdf_truncation_voxels, None)
    scaled = np.where(scaled < 0, np.minimum(scaled, -MIN_VALUE), np.maximum(scaled, MIN_VALUE))
    grid = np.full(shape, np.nan, dtype=np.float32)
    grid[tuple(cells[known].T)] = scaled
    mask = whole_cells(np.isfinite(grid))
    grid[np.isnan(grid)] = 0.0
    if not (scaled < 0).any() or not (scaled > 0).any():
        raise InputError("The signed distance has no zero: the normals of the cloud contradict.")
    try:
        vertices, faces, _, _ = measure.marching_cubes(
            grid, 0.0, mask=mask, gradient_direction="descent"
        )
    except RuntimeError as error:
        raise InputError(
            "The signed distance has no zero where it is known: the cloud is too sparse."
        ) from error
    vertices = origin + voxel * vertices.astype(np.float64)
    colors = None
    if task.cloud.colors is not None:
        colors = np.asarray(task.cloud.colors)[tree.query(vertices, workers=-1)[1]]
    return RawSurface(vertices=vertices, faces=faces.astype(np.int64), colors=colors)


def whole_cells(known: Bool) -> Bool:
    """The far corners of the cells all of whose eight corners are known, as scikit-image asks.

    Parameters
    ----------
    known : (I, J, K) voxels with a value

    """
    lower, upper = slice(None, -1), slice(1, None)
    whole: Bool = np.ones(tuple(n - 1 for n in known.shape), dtype=bool)
    for i in (lower, upper):
        for j in (lower, upper):
            for k in (lower, upper):
                whole &= known[i, j, k]
    mask: Bool = np.zeros(known.shape, dtype=bool)
    mask[1:, 1:, 1:] = whole
    return mask


def near_points(
    points: Float, origin: Float, voxel: float, shape: tuple[int, ...], reach: float
) -> Bool:
    """Voxels within `reach` voxels, along each axis, of one that holds a point: bool, `shape`."""
    from scipy.ndimage import maximum_filter

    occupied: Array = np.zeros(shape, dtype=np.uint8)
    cell: Int = np.rint((points - origin) / voxel).astype(np.int64)
    occupied[tuple(cell.T)] = 1
    return np.asarray(maximum_filter(occupied, size=2 * int(np.ceil(reach)) + 1) > 0)


def distance_to_points(x: Float, task: MeshTask, distance: Float, idx: Int) -> Float:
    """The signed distance to the planes of the nearest points: (n,)."""
    weight = np.exp(-2.0 * (distance**2 - distance[:, :1] ** 2) / task.spacing**2)
    offset = np.einsum(
        "nki,nki->nk", x[:, None] - task.cloud.points[idx], task.normals[idx], optimize=True
    )
    return np.asarray((weight * offset).sum(axis=1) / weight.sum(axis=1))


def distance_to_maps(
    x: Float, task: MeshTask, views: Sequence[DepthView], nearest: Int, truncation: float
) -> Float:
    """The mean signed distance to the surfaces of the depth maps, nan where no map has a say."""
    total, weights = np.zeros(len(x)), np.zeros(len(x))
    normal = task.normals[nearest]
    for view in views:
        u, v, z = view.project(x)
        gap = view.depth_at(u, v) - z
        ray = view.rays(x)
        facing = -np.einsum("ni,ni->n", normal, ray)
        along = ray @ view.depth_row[:3]
        signed = gap * np.abs(facing) / along
        counts = np.isfinite(signed) & (signed > -truncation) & (facing > 0)
        weight = np.where(counts, facing, 0.0)
        total += weight * np.where(counts, np.minimum(signed, truncation), 0.0)
        weights += weight
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weights > 0, total / weights, np.nan)
