"""A height field over the mean viewing direction, triangulated by Delaunay's criterion.

With d the mean viewing direction, points are projected along d and triangulated in that plane; a
triangle with an edge in space longer than some spacings bridges a hole, a step or a bay of the
outline, and goes, so that holes stay holes. Points whose normals turn away from the viewer hide
below others and are left out. Under parallel projection this is the surface that one image could
see: right for fields, wrong for what was seen from all sides, which is refused.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.fusion.cloud import voxel_groups
from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Bool, Float, Int

MIN_MEAN_NORMAL = 0.2
"""Length of the mean normal: 1 for a flat field, 0.5 for half a ball, 0 for a whole one."""
MIN_COSINE = 0.05
"""Points seen at a steeper slant than 87 degrees have no place in a height field."""
CELL = 0.3
"""Of the points in a cell of so many b of the plane the one nearest to the viewer counts."""


def make_surface(task: MeshTask, options: SurfaceOptions) -> RawSurface:
    """The height field, facing the viewers."""
    from scipy.spatial import Delaunay, QhullError

    toward = task.normals.mean(axis=0)
    length = float(np.linalg.norm(toward))
    if length < MIN_MEAN_NORMAL:
        raise InputError(
            "The points were seen from all sides and are no height field over one direction: use "
            "surface.method = ball-pivoting, poisson or tsdf."
        )
    toward /= length
    basis = plane_basis(toward)
    points = task.cloud.points
    rows = np.flatnonzero(task.normals @ toward > MIN_COSINE)
    rows = rows[nearest_of_cell(points[rows] @ basis, points[rows] @ toward, CELL * task.spacing)]
    try:
        faces = Delaunay(points[rows] @ basis).simplices.astype(np.int64)
    except (QhullError, ValueError) as error:
        raise InputError(
            "The points that face the viewer lie on a line: no triangles between them."
        ) from error
    vertices = points[rows]
    corner = vertices[faces]
    longest = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).max(axis=1)
    # of a, b, toward a right-handed frame: counter-clockwise in the plane faces the viewer
    a, b = ((corner[:, k] - corner[:, 0]) @ basis for k in (1, 2))
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    faces = np.where(clockwise[:, None], faces[:, ::-1], faces)
    colors = None if task.cloud.colors is None else np.asarray(task.cloud.colors)[rows]
    short = longest <= options.max_edge_factor * task.spacing
    return RawSurface(vertices=vertices, faces=faces[short], colors=colors)


def plane_basis(normal: Float) -> Float:
    """Two unit vectors e1, e2 with e1 x e2 = n, as columns: (3, 2)."""
    e1 = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    e1 /= np.linalg.norm(e1)
    return np.column_stack([e1, np.cross(normal, e1)])


def nearest_of_cell(plane: Float, height: Float, size: float) -> Int:
    """In each square cell of the plane the highest point: (N, 2), (N,) -> indices."""
    if len(plane) == 0:
        return np.zeros(0, dtype=np.int64)
    group, _ = voxel_groups(np.column_stack([plane, np.zeros(len(plane))]), size)
    order = np.lexsort((-height, group))
    first: Bool = np.concatenate([[True], np.diff(group[order]) > 0])
    return np.sort(order[first])
