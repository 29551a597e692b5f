"""Crossing triangles by all pairs, in double precision."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int, TriangleMesh


def crossing_faces_by_pairs(mesh: TriangleMesh, end: float) -> Int:
    """Faces of pairs, one of them filled, of which an edge of one passes through the other."""
    assert mesh.face_filled is not None
    found = set()
    for i, a in enumerate(mesh.faces):
        for j, b in enumerate(mesh.faces):
            if i == j or not (mesh.face_filled[i] or mesh.face_filled[j]):
                continue
            for k in range(3):
                edge = a[k], a[(k + 1) % 3]
                if set(edge) & set(b.tolist()):
                    continue
                if pierces(*mesh.vertices[list(edge)], mesh.vertices[b], end):
                    found |= {i, j}
    return np.array(sorted(found), dtype=np.int64)


def pierces(start: Float, stop: Float, triangle: Float, end: float) -> bool:
    """``start + t (stop - start) = a + u (b - a) + v (c - a)`` solved for t, u, v."""
    a, b, c = triangle
    t, u, v = np.linalg.solve(np.column_stack([stop - start, a - b, a - c]), a - start)
    return bool(end < t < 1 - end and u >= 0 and v >= 0 and u + v <= 1)
