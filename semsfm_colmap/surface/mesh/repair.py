"""Make a triangle soup an oriented manifold: no duplicate faces, no branching edges, few holes.

The steps of `repair` in their order: drop faces without area, turn faces outside, cut where more
than two faces meet, drop fins and crumbs, fill holes. What the words mean is in `halfedges.py`.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.halfedges import (
    component_labels,
    directed_keys,
    opposite_halfedge,
    vertex_fans,
)
from semsfm_colmap.types import Array, Float, Int

PARTING = 0.01
"""Of the distance from a vertex to the middle of its faces."""
MIN_HEIGHT = 1e-5
"""A triangle lower than this share of its longest edge has no direction: float32 holds 1e-7."""


def repair(
    vertices: Float,
    faces: Int,
    *,
    cloud_normals: Float,
    min_component_fraction: float,
    oriented: bool = False,
) -> Int:
    """Clean faces over the same vertices: oriented, edge-manifold, without crumbs.

    Parameters
    ----------
    vertices : (V, 3)
    faces : (F, 3)
    cloud_normals : (V, 3) that point outside
    min_component_fraction : of the faces of the largest component
    oriented : the faces are turned outside already, and stay as they are

    """
    faces = drop_degenerate(vertices, faces)
    if not oriented:
        faces = face_outside(vertices, faces, cloud_normals)
    faces = drop_branches(vertices, faces)
    faces = drop_fins(faces)
    return drop_small_components(faces, min_component_fraction)


def welded(vertices: Float, faces: Int) -> tuple[Float, Int]:
    """Vertices in the same place joined, and the faces that branch or vanish thereby dropped.

    Decimation leaves vertices that touch, edges that coincide and needles: whoever joins vertices
    by their place, as most readers do, would see a mesh that branches.

    Returns
    -------
    (V', 3), (F', 3) an oriented manifold; fans that meet in a point have a vertex each

    """
    places, number = np.unique(vertices, axis=0, return_inverse=True)
    joined = drop_degenerate(places, number.reshape(-1)[faces])
    vertices, faces, _ = compact(places, drop_branches(places, joined), None)
    return vertices, faces


def drop_degenerate(vertices: Float, faces: Int) -> Int:
    """Without faces that repeat a vertex or another face, or are needles without a height."""
    a, b, c = faces.T
    keep = (a != b) & (b != c) & (c != a)
    double_area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    keep &= double_area > MIN_HEIGHT * _longest_edge(vertices, faces) ** 2
    faces = faces[keep]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return np.asarray(faces[np.sort(first)])


def face_outside(vertices: Float, faces: Int, normals: Float) -> Int:
    """Turn each face so that its normal agrees with the mean normal of its vertices."""
    inside = np.einsum("fi,fki->f", face_normals(vertices, faces), normals[faces]) < 0
    return np.where(inside[:, None], faces[:, ::-1], faces)


def drop_branches(vertices: Float, faces: Int) -> Int:
    """Remove the longest-edged faces until every directed edge occurs once."""
    while len(faces):
        length = _longest_edge(vertices, faces)
        key = directed_keys(faces, len(vertices))
        face_idx = np.repeat(np.arange(len(faces)), 3)
        order = np.lexsort((length[face_idx], key))
        repeated = np.flatnonzero(key[order][1:] == key[order][:-1]) + 1
        if len(repeated) == 0:
            break
        keep = np.ones(len(faces), dtype=bool)
        keep[face_idx[order[repeated]]] = False
        faces = faces[keep]
    return faces


def drop_fins(faces: Int, num_rounds: int = 2) -> Int:
    """Remove faces that hang on by one edge or by vertices only, which fray the boundary."""
    for _ in range(num_rounds):
        free = (opposite_halfedge(faces) < 0).reshape(-1, 3).sum(axis=1)
        if not (free >= 2).any():
            break
        faces = faces[free < 2]
    return faces


def drop_small_components(faces: Int, min_fraction: float) -> Int:
    """Remove pieces, joined over edges, with fewer faces than a share of the largest piece."""
    if len(faces) == 0:
        return faces
    label = component_labels(faces)
    size = np.bincount(label)
    return np.asarray(faces[size[label] >= min_fraction * size.max()])


def compact(vertices: Float, faces: Int, colors: Array | None) -> tuple[Float, Int, Array | None]:
    """Drop unused vertices and give each fan of faces around a vertex a vertex of its own."""
    fan, source = vertex_fans(faces)
    return vertices[source], fan, None if colors is None else colors[source]


def part_touching(vertices: Float, faces: Int) -> Float:
    """Vertices of which no two are in one place: those that are move `PARTING` into their fan.

    Fans that meet in a point have a vertex each there (`compact`). Formats without shared vertices,
    such as STL, join them again, and two fillings that meet in such a place would share an edge.
    """
    _, number, count = np.unique(vertices, axis=0, return_inverse=True, return_counts=True)
    touching = count[number.reshape(-1)] > 1
    corner = faces.reshape(-1)
    middle = np.repeat(vertices[faces].mean(axis=1), 3, axis=0)
    num = np.maximum(np.bincount(corner, minlength=len(vertices)), 1)[:, None]
    into = np.stack(
        [np.bincount(corner, weights=m, minlength=len(vertices)) for m in middle.T], axis=1
    )
    return np.where(touching[:, None], vertices + PARTING * (into / num - vertices), vertices)


def _longest_edge(vertices: Float, faces: Int) -> Float:
    corner = vertices[faces]
    edge = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
    return np.asarray(edge.max(axis=1))
