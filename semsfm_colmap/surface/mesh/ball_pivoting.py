"""A triangle mesh from an oriented cloud: ball pivoting, or Poisson, and then repair.

Ball pivoting (Bernardini et al., IEEE TVCG 1999) rolls a ball of radius r over the points; three
points that it touches without holding a fourth become a triangle. Radii are multiples of b, the
median distance to the 8th neighbour, so that they follow the density. Noise of the size of r
breaks the surface into fragments, hence the order: merge points on a grid, smooth along the
normals, pivot, repair, drop fragments, fill small holes. Poisson (Kazhdan et al. 2006) fits an
implicit surface instead; it invents surface where nothing was seen, so vertices far from every
point are cut away.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.surface.fusion.cloud import MIN_CLOUD_POINTS, smooth_along_normals, thin
from semsfm_colmap.surface.mesh.fill import filled
from semsfm_colmap.surface.mesh.repair import compact, repair
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Float, Int, PointCloud, TriangleMesh

_POISSON_MAX_DISTANCE = 3.0
"""Poisson vertices farther than this many b from every point are invented: cut."""


def mesh_cloud(cloud: PointCloud, options: SurfaceOptions) -> TriangleMesh:
    """Mesh an oriented cloud, with vertex colours and normals toward the viewers.

    Raises
    ------
    InputError
        When the cloud is too small, or no surface comes of it.

    """
    if cloud.normals is None:
        raise UsageError("cloud.normals is None: estimate normals before meshing.")
    if len(cloud.points) < MIN_CLOUD_POINTS:
        raise InputError(
            f"The cloud has {len(cloud.points)} points, too few for a mesh "
            f"(at least {MIN_CLOUD_POINTS}): densify, or match more images."
        )
    b = sampling_distance(cloud.points)
    cloud = thin(cloud, options.thinning_factor * b)
    cloud = smooth_along_normals(
        cloud, options.num_normal_neighbors, options.num_smoothing_iterations
    )
    b = sampling_distance(cloud.points)
    if options.method == "ball_pivoting":
        vertices, faces, colors = _ball_pivoting(cloud, b, options)
    else:
        vertices, faces, colors = _poisson(cloud, b, options)
    faces = repair(
        vertices,
        faces,
        cloud_normals=_nearest(cloud, vertices),
        min_component_fraction=options.min_component_fraction,
        max_hole_edges=0,
    )
    if len(faces) == 0:
        raise InputError(
            "No surface came of the point cloud: it is too sparse or too noisy; "
            "densify first, or try surface.method = poisson."
        )
    normals = _nearest(cloud, vertices)
    faces, closing = filled(vertices, faces, normals, options.fill_holes, options.max_hole_edges)
    vertices, faces, colors = compact(vertices, faces, colors)
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertex_normals(vertices, faces),
        vertex_colors=colors,
        face_filled=closing,
    )


def _ball_pivoting(
    cloud: PointCloud, b: float, options: SurfaceOptions
) -> tuple[Float, Int, Array | None]:
    o3d = import_open3d()
    radii = o3d.utility.DoubleVector([f * b for f in sorted(options.ball_radius_factors)])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(_to_open3d(cloud), radii)
    faces = np.asarray(mesh.triangles).astype(np.int64)
    return np.array(cloud.points), faces, cloud.colors


def _poisson(
    cloud: PointCloud, b: float, options: SurfaceOptions
) -> tuple[Float, Int, Array | None]:
    from scipy.spatial import cKDTree

    o3d = import_open3d()
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        _to_open3d(cloud), depth=options.poisson_depth, linear_fit=False
    )
    vertices = np.array(mesh.vertices)
    faces = np.asarray(mesh.triangles).astype(np.int64)
    density = np.asarray(density)
    distance, _ = cKDTree(cloud.points).query(vertices, workers=-1)
    keep = distance <= _POISSON_MAX_DISTANCE * b
    keep &= density >= np.quantile(density, options.poisson_trim_quantile)
    colors = None
    if cloud.colors is not None:
        colors = np.clip(np.rint(np.asarray(mesh.vertex_colors) * 255), 0, 255).astype(np.uint8)
    return vertices, faces[keep[faces].all(axis=1)], colors


def _nearest(cloud: PointCloud, vertices: Float) -> Float:
    """Cloud normals at the mesh's vertices: (V, 3)."""
    from scipy.spatial import cKDTree

    assert cloud.normals is not None
    _, idx = cKDTree(cloud.points).query(vertices, workers=-1)
    return np.asarray(cloud.normals[idx])


def _to_open3d(cloud: PointCloud) -> object:
    o3d = import_open3d()
    out = o3d.geometry.PointCloud()
    out.points = o3d.utility.Vector3dVector(np.array(cloud.points, dtype=float))
    out.normals = o3d.utility.Vector3dVector(np.array(cloud.normals, dtype=float))
    if cloud.colors is not None:
        out.colors = o3d.utility.Vector3dVector(np.asarray(cloud.colors, dtype=float) / 255.0)
    return out
