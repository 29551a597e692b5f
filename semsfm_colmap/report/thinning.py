"""Fewer points and fewer faces for the screen; the files on disk keep them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.types import Array, Int, TriangleMesh

GOLDEN = 0.6180339887498949
"""Multiples of the golden ratio modulo 1 fill the unit interval evenly, without the beat that a
fixed stride has with rows of pixels."""
MAX_SEARCH = 40
"""Halvings of the cell size: from the whole box to 1e-12 of it."""


def even_subset(num: int, max_num: int) -> Int:
    """Increasing indices of at most `max_num` of `num` items, spread evenly over their order."""
    if num <= max_num:
        return np.arange(num)
    rank = np.argpartition(np.arange(num) * GOLDEN % 1.0, max_num)
    return np.sort(rank[:max_num])


def vertex_colors(mesh: TriangleMesh) -> Array | None:
    """(V, 3) uint8: the mesh's own colours, or its texture looked up at each vertex."""
    if mesh.vertex_colors is not None:
        return mesh.vertex_colors
    if mesh.uv is None or mesh.texture is None or len(mesh.faces) == 0:
        return None
    height, width = mesh.texture.shape[:2]
    uv = mesh.uv.reshape(-1, 2)
    column = np.clip((uv[:, 0] * width).astype(np.int64), 0, width - 1)
    row = np.clip(((1.0 - uv[:, 1]) * height).astype(np.int64), 0, height - 1)
    colors = np.full((len(mesh.vertices), 3), 160, dtype=np.uint8)
    colors[mesh.faces.reshape(-1)] = mesh.texture[row, column].reshape(len(uv), -1)[:, :3]
    return colors


def _cluster(mesh: TriangleMesh, cell: float) -> tuple[Int, Int]:
    """Merge the vertices in each cubic cell: labels of the vertices, and the faces that remain."""
    key = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    extent = key.max(axis=0) + 1
    flat = (key[:, 0] * extent[1] + key[:, 1]) * extent[2] + key[:, 2]
    label = np.unique(flat, return_inverse=True)[1]
    faces = label[mesh.faces]
    distinct = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    faces = faces[distinct]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return label, faces[np.sort(first)]


def thin_mesh(mesh: TriangleMesh, max_faces: int) -> TriangleMesh:
    """Merge vertices on the finest cubic grid that leaves at most `max_faces` faces.

    Coarse but quick, and it needs no more than numpy [Rossignac and Borrel 1993]. Keeps vertex
    colours (averaged); drops texture coordinates.
    """
    colors = vertex_colors(mesh)
    if len(mesh.faces) <= max_faces:
        return replace(mesh, vertex_colors=colors, uv=None, texture=None)
    box = float(np.max(np.ptp(mesh.vertices, axis=0)))
    fine, coarse = 0.0, box
    for _ in range(MAX_SEARCH):
        cell = 0.5 * (fine + coarse)
        if len(_cluster(mesh, cell)[1]) <= max_faces:
            coarse = cell
        else:
            fine = cell
        if coarse - fine < 0.02 * coarse:
            break
    label, faces = _cluster(mesh, coarse)
    num = np.bincount(label)[:, None]

    def mean(values: Array) -> Array:
        return np.stack([np.bincount(label, weights=v) for v in values.T], axis=1) / num

    return TriangleMesh(
        vertices=mean(mesh.vertices),
        faces=faces,
        vertex_colors=None if colors is None else mean(colors).astype(np.uint8),
    )
