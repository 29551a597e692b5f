"""Faces that close holes and pass through other faces of the mesh.

Two triangles in general position cross where an edge of one pierces the other. So every edge of a
filling is cast as a ray at the whole mesh, and every edge of the mesh at the fillings; hits on
faces that hold an end of the edge are contacts, not crossings. The rays are single precision: hits
within `END` of an edge's ends do not count, and triangles that overlap in one plane are not found.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.types import Bool, Float, Int, TriangleMesh

END = 1e-4
"""Share of an edge at either end."""


def crossing_faces(mesh: TriangleMesh) -> Int:
    """Rows of the faces, filled or seen, of which one of a pair is filled and both cross: (K,)."""
    if mesh.face_filled is None or not mesh.face_filled.any():
        return np.zeros(0, dtype=np.int64)
    filled = np.flatnonzero(mesh.face_filled)
    everything = np.arange(len(mesh.faces))
    pairs = np.concatenate(
        [
            _pierced(mesh.vertices, mesh.faces, filled, everything),
            _pierced(mesh.vertices, mesh.faces, everything, filled),
        ]
    )
    return np.unique(pairs)


def crossing_sentence(num: int) -> str:
    """What is said of a closed mesh with so many crossing faces."""
    return (
        f"{num} faces pass through one another where holes were closed: slicers unite them, but "
        "programs that need a body without crossings, for boolean operations or tetrahedra, refuse "
        "the mesh"
    )


def _pierced(vertices: Float, faces: Int, edges_of: Int, targets: Int) -> Int:
    """Faces whose edges pierce a target, and that target: (K, 2) rows."""
    ends = np.stack([faces[edges_of], np.roll(faces[edges_of], -1, axis=1)], axis=2).reshape(-1, 2)
    owner = np.repeat(edges_of, 3)
    # relative to the middle, for the sake of single precision
    place = vertices - vertices.mean(axis=0)
    scene = ray_scene(place, faces[targets])
    start = place[ends[:, 0]]
    hits = scene.list_intersections(ray_tensor(start, place[ends[:, 1]] - start))
    ray = hits["ray_ids"].numpy().astype(np.int64)
    target = targets[hits["primitive_ids"].numpy().astype(np.int64)]
    t = hits["t_hit"].numpy()
    touches: Bool = (faces[target][:, :, None] == ends[ray][:, None, :]).any(axis=(1, 2))
    crossing = (t > END) & (t < 1.0 - END) & ~touches
    return np.column_stack([owner[ray[crossing]], target[crossing]])
