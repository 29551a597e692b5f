"""The convex hull: the smallest convex body that holds the points.

Its volume bounds that of the specimen from above, its area is that of a sheet wrapped around it;
both need no normals and no density [Barber, Dobkin, Huhdanpaa, ACM TOMS 22(4), 1996: Qhull].
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Float, Int

MIN_THICKNESS = 1e-6
"""A cloud thinner than this share of its length encloses nothing."""


def make_surface(task: MeshTask, options: SurfaceOptions) -> RawSurface:
    """The hull of all points, facing outside."""
    vertices, faces, used = hull(task.cloud.points)
    colors = None if task.cloud.colors is None else np.asarray(task.cloud.colors)[used]
    return RawSurface(vertices=vertices, faces=faces, colors=colors)


def hull(points: Float) -> tuple[Float, Int, Array]:
    """Corners (V, 3), triangles facing outside (F, 3), and which points the corners are (V,)."""
    from scipy.spatial import ConvexHull

    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or singular[2] <= MIN_THICKNESS * singular[0]:
        raise InputError(
            "The points lie in a plane, which encloses no volume: use surface.method = "
            "ball-pivoting or delaunay-2.5d."
        )
    found = ConvexHull(points)
    faces = found.simplices.astype(np.int64)
    inward = np.einsum("fi,fi->f", face_normals(points, faces), found.equations[:, :3]) < 0
    faces = np.where(inward[:, None], faces[:, ::-1], faces)
    used, renumbered = np.unique(faces, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3), used
