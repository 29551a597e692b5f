"""Normals of triangle meshes. Faces are counter-clockwise seen from outside."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int


def face_normals(vertices: Float, faces: Int) -> Float:
    """(F, 3) normals with twice the area as their length."""
    corner = vertices[faces]
    return np.asarray(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))


def vertex_normals(vertices: Float, faces: Int) -> Float:
    """(V, 3) unit means of the adjacent face normals, weighted with area; 0 without faces."""
    total = np.zeros_like(vertices, dtype=np.float64)
    normal = face_normals(vertices, faces)
    for k in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(
                faces[:, k], weights=normal[:, axis], minlength=len(vertices)
            )
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))


def angle_weighted_normals(vertices: Float, faces: Int) -> Float:
    """(V, 3) unit means of the adjacent face normals, weighted with their angle at the vertex.

    With these the sign of ``(p - q) . n(q)``, q the point of the mesh closest to p, tells outside
    from inside even where q is a vertex [Baerentzen, Aanaes, IEEE TVCG 11(3), 2005].
    """
    corner = vertices[faces]
    normal = _unit(face_normals(vertices, faces))
    total = np.zeros((len(vertices), 3))
    for k in range(3):
        e1 = _unit(corner[:, (k + 1) % 3] - corner[:, k])
        e2 = _unit(corner[:, (k + 2) % 3] - corner[:, k])
        angle = np.arccos(np.clip(np.sum(e1 * e2, axis=1), -1.0, 1.0))
        for axis in range(3):
            weight = angle * normal[:, axis]
            total[:, axis] += np.bincount(faces[:, k], weights=weight, minlength=len(vertices))
    return _unit(total)


def _unit(v: Float) -> Float:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
