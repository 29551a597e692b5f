"""Meshes whose texture coordinates belong to corners, as programs want them that draw them."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.types import Array, Float, Int, TriangleMesh


def unshared(mesh: TriangleMesh) -> tuple[Float, Float, Float, Int]:
    """One vertex for each distinct pair of vertex and texture coordinate.

    Returns
    -------
    vertices, normals (V', 3), texture coordinates (V', 2), faces (F, 3)

    """
    assert mesh.uv is not None
    corner = mesh.faces.reshape(-1)
    uv: Array = np.asarray(mesh.uv, dtype=np.float64).reshape(-1, 2)
    key = np.column_stack([corner, np.rint(uv * 2**24)]).astype(np.int64)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    normals = mesh.vertex_normals
    if normals is None:
        normals = vertex_normals(mesh.vertices, mesh.faces)
    source = corner[first]
    return mesh.vertices[source], normals[source], uv[first], inverse.reshape(-1, 3)
