"""Make a triangle soup an oriented manifold: no duplicate faces, no branching edges, no crumbs.

`repair` drops faces without area, turns faces outside and cuts where more than two faces meet.
What frays the surface, fins and crumbs, is dropped by `worth_keeping` once holes are filled: many a
fin is half of what closes a hole. What the words mean is in `halfedges.py`.
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
from semsfm_colmap.types import Array, Bool, Float, Int

PARTING = 0.01
"""Of the distance from a vertex to the middle of its faces."""
MIN_HEIGHT = 1e-5
"""A triangle lower than this share of its longest edge has no direction: float32 holds 1e-7."""


def repair(vertices: Float, faces: Int, *, cloud_normals: Float, oriented: bool = False) -> Int:
    """Clean faces over the same vertices: oriented and edge-manifold.

    Parameters
    ----------
    vertices : (V, 3)
    faces : (F, 3)
    cloud_normals : (V, 3) that point outside
    oriented : the faces are turned outside already, and stay as they are

    """
    faces = drop_degenerate(vertices, faces)
    if not oriented:
        faces = face_outside(vertices, faces, cloud_normals)
    return drop_branches(vertices, faces)


def worth_keeping(faces: Int, min_component_fraction: float, max_crumb_faces: int) -> Bool:
    """Faces of an edge-manifold mesh that are neither fins nor crumbs: (F,).

    Fins hang on by one edge or by vertices only. Crumbs are pieces with fewer faces than a share of
    the largest piece has, and than `max_crumb_faces`.
    """
    keep = not_fins(faces)
    keep[keep] = in_large_components(faces[keep], min_component_fraction, max_crumb_faces)
    return keep


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


def not_fins(faces: Int) -> Bool:
    """Faces that hang on by two edges or more: (F,)."""
    free = (opposite_halfedge(faces) < 0).reshape(-1, 3).sum(axis=1)
    return np.asarray(free < 2)


def in_large_components(faces: Int, min_fraction: float, max_faces: int | None = None) -> Bool:
    """Faces of pieces, joined over edges, that are as large as a share of the largest one: (F,).

    With `max_faces`, pieces of so many faces are large at any rate.
    """
    if len(faces) == 0:
        return np.zeros(0, dtype=bool)
    label = component_labels(faces)
    size = np.bincount(label)
    least = min_fraction * size.max()
    return np.asarray(size[label] >= (least if max_faces is None else min(least, max_faces)))


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
