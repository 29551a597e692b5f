"""A triangle mesh from an oriented cloud: thinned and smoothed, meshed by a method, repaired.

Noise of the size of a method's own length breaks the surface into fragments, hence the order: merge
points on a grid, smooth along the normals, mesh, repair, drop fragments, fill holes. Lengths
are multiples of b, the median distance to the 8th neighbour, so that they follow the density.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.io.ply import position_type
from semsfm_colmap.surface.depth_view import DepthView
from semsfm_colmap.surface.fusion.cloud import MIN_CLOUD_POINTS, smooth_along_normals, thin
from semsfm_colmap.surface.mesh.close import close_holes
from semsfm_colmap.surface.mesh.holes import fill_holes
from semsfm_colmap.surface.mesh.methods.registry import find_method
from semsfm_colmap.surface.mesh.methods.task import MeshTask
from semsfm_colmap.surface.mesh.repair import (
    compact,
    drop_degenerate,
    in_large_components,
    repair,
    worth_keeping,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Float, PointCloud, TriangleMesh

MIN_WIDTH = 1e-6
"""A cloud narrower than this share of its length is a line."""

MAX_EXPONENT = 8
"""A cloud whose spacing is a power of two beyond this, as of a specimen in metres, is scaled."""


def mesh_cloud(
    cloud: PointCloud, options: SurfaceOptions, views: Sequence[DepthView] = ()
) -> TriangleMesh:
    """Mesh an oriented cloud, with vertex colours and normals toward the viewers.

    The mesh is an oriented manifold, with a boundary unless all holes are to be closed, and its
    vertices are numbers that a file holds: it says exactly what was checked. Faces that close a
    hole are marked.

    Parameters
    ----------
    cloud : with normals
    options : method and its lengths
    views : depth maps of the same surface, for the methods that use them

    Raises
    ------
    InputError
        When the cloud is too small, or no surface comes of it.

    """
    method = find_method(options.method)
    if cloud.normals is None:
        raise UsageError("cloud.normals is None: estimate normals before meshing.")
    if len(cloud.points) < MIN_CLOUD_POINTS:
        raise InputError(
            f"The cloud has {len(cloud.points)} points, too few for a mesh "
            f"(at least {MIN_CLOUD_POINTS}): densify, or match more images."
        )
    b = sampling_distance(cloud.points)
    if not b > 0:
        raise InputError("Most points of the cloud lie in one place: no surface comes of it.")
    spread = np.linalg.svd(cloud.points - cloud.points.mean(axis=0), compute_uv=False)
    if spread[1] <= MIN_WIDTH * spread[0]:
        raise InputError("No surface comes of the points: they lie on a line.")
    fixed = method.sees_views and len(views) > 0
    if position_type(cloud.points).itemsize > 4 and not fixed:
        # meshers that compute in float32 would blur the surface
        centre = cloud.points.mean(axis=0)
        near = mesh_cloud(replace(cloud, points=cloud.points - centre), options)
        return replace(near, vertices=near.vertices + centre)
    exponent = round(float(np.log2(b)))
    if abs(exponent) > MAX_EXPONENT and not fixed:
        # meshers hold lengths against absolute ones; a power of two changes no digit
        unit = 2.0**exponent
        near = mesh_cloud(replace(cloud, points=cloud.points / unit), options)
        return replace(near, vertices=near.vertices * unit)
    if method.thins:
        cloud = thin(cloud, options.thinning_factor * b)
        cloud = smooth_along_normals(
            cloud, options.num_normal_neighbors, options.num_smoothing_iterations
        )
        if len(cloud.points) < MIN_CLOUD_POINTS:
            raise InputError(
                f"Only {len(cloud.points)} points are left where they are merged, too few for a "
                "mesh: densify, or match more images."
            )
        b = sampling_distance(cloud.points)
    raw = method.mesher()(MeshTask(cloud=cloud, spacing=b, views=views), options)
    vertices = as_stored(raw.vertices)
    normals = _nearest_normals(cloud, vertices)
    faces = repair(vertices, raw.faces, cloud_normals=normals, oriented=raw.oriented)
    filled = np.zeros(len(faces), dtype=bool)
    if options.fill_holes != "none" or options.watertight:
        num_seen = len(faces)
        faces = fill_holes(vertices, faces, normals, options.max_hole_edges)
        faces = drop_degenerate(vertices, faces)
        # what closes holes stands behind what was seen
        filled = np.arange(len(faces)) >= num_seen
    keep = worth_keeping(faces, options.min_component_fraction, options.max_crumb_faces)
    faces, filled = faces[keep], filled[keep]
    if len(faces) == 0:
        raise InputError(
            f"No surface came of the point cloud by {method.name}: it is too sparse or too noisy; "
            "densify first, or try surface.method = poisson."
        )
    if options.watertight:
        keep = in_large_components(faces, 1.0)
        faces, filled = faces[keep], filled[keep]
    vertices, faces, colors = compact(vertices, faces, raw.colors)
    if options.fill_holes == "all" or options.watertight:
        vertices, faces, colors = close_holes(vertices, faces, colors)
        vertices = as_stored(vertices)
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertex_normals(vertices, faces),
        vertex_colors=colors,
        face_filled=np.concatenate([filled, np.ones(len(faces) - len(filled), dtype=bool)]),
    )


def as_stored(vertices: Float) -> Float:
    """The nearest numbers that a file holds, float32 unless the origin is far away."""
    return np.asarray(vertices, dtype=position_type(vertices)).astype(np.float64)


def _nearest_normals(cloud: PointCloud, vertices: Float) -> Float:
    """Cloud normals at the mesh's vertices: (V, 3)."""
    from scipy.spatial import cKDTree

    assert cloud.normals is not None
    if len(vertices) == 0:
        return np.zeros((0, 3))
    _, idx = cKDTree(cloud.points).query(vertices, workers=-1)
    return np.asarray(cloud.normals[idx])
