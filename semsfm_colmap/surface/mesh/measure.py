"""Area and volume of a mesh and of its convex hull."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.halfedges import num_boundary_edges
from semsfm_colmap.surface.mesh.methods.convex_hull import hull
from semsfm_colmap.types import Float, Int, TriangleMesh


@dataclass(frozen=True, kw_only=True)
class Size:
    """In world units, squared and cubed."""

    area: float
    volume: float | None
    """None for a surface with a boundary, which encloses nothing"""
    hull_area: float | None
    """None for vertices in a plane"""
    hull_volume: float | None


def measure(mesh: TriangleMesh) -> Size:
    """Area and volume of the mesh and of its hull."""
    closed = num_boundary_edges(mesh.faces) == 0
    hull_area = hull_volume = None
    try:
        corners, faces, _ = hull(mesh.vertices)
        hull_area, hull_volume = area(corners, faces), volume(corners, faces)
    except InputError:
        pass
    return Size(
        area=area(mesh.vertices, mesh.faces),
        volume=volume(mesh.vertices, mesh.faces) if closed else None,
        hull_area=hull_area,
        hull_volume=hull_volume,
    )


def area(vertices: Float, faces: Int) -> float:
    """Of all faces."""
    return float(0.5 * np.linalg.norm(face_normals(vertices, faces), axis=1).sum())


def volume(vertices: Float, faces: Int) -> float:
    """Enclosed by a closed mesh that faces outside, ``sum a . (b x c) / 6`` over its faces."""
    # relative to the middle, so that no large numbers cancel
    corner = (vertices - vertices.mean(axis=0))[faces]
    return float(np.einsum("fi,fi->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0)
