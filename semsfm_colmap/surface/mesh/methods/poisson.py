"""Screened Poisson reconstruction [Kazhdan, Hoppe, ACM TOG 32(3), 2013].

The surface is where a function crosses a level whose gradient fits the normals. It is smooth, and
it goes on where nothing was seen, up to the border of its grid: vertices far from every point, and
the least supported ones, are cut away, also where a closed surface is asked for.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.surface.mesh.methods.open3d_cloud import to_open3d
from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
from semsfm_colmap.surface.options import SurfaceOptions

_MAX_DISTANCE = 3.0
"""Vertices farther than this many b from every point are invented: cut."""


def make_surface(task: MeshTask, options: SurfaceOptions) -> RawSurface:
    """The trimmed surface."""
    from scipy.spatial import cKDTree

    o3d = import_open3d()
    # with more threads the order of its sums, and so the mesh, changes from run to run
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        to_open3d(task.cloud), depth=options.poisson_depth, linear_fit=False, n_threads=1
    )
    vertices = np.array(mesh.vertices)
    faces = np.asarray(mesh.triangles).astype(np.int64)
    density = np.asarray(density)
    distance, _ = cKDTree(task.cloud.points).query(vertices, workers=-1)
    keep = distance <= _MAX_DISTANCE * task.spacing
    keep &= density >= np.quantile(density, options.poisson_trim_quantile)
    faces = faces[keep[faces].all(axis=1)]
    colors = None
    if task.cloud.colors is not None:
        colors = np.clip(np.rint(np.asarray(mesh.vertex_colors) * 255), 0, 255).astype(np.uint8)
    return RawSurface(vertices=vertices, faces=faces, colors=colors)
