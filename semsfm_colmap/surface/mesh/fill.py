"""Which holes of a mesh are closed, and which of its faces nobody has seen.

Small holes continue the surface around them (`holes.fill_holes`). On request all rims are closed: a
rim with more than `MAX_CORNERS` edges is first spanned between so many of its corners, evenly
chosen, then each arc between two of these against its chord, and so on, so that the cost stays near
that of the small polygon. The rim of a sheet then gets a lid, which may lie on the sheet. Faces
that close a hole stand at the end and are marked: what was not seen is not taken for what was.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from semsfm_colmap.surface.mesh.halfedges import directed_keys
from semsfm_colmap.surface.mesh.holes import best_triangulation, boundary_loops, fill_holes
from semsfm_colmap.types import Bool, Float, Int

MAX_CORNERS = 48
"""Rims with more edges are spanned between so many of their corners first."""

FillHoles = Literal["none", "small", "all"]
"""Which holes are closed."""


def filled(
    vertices: Float, faces: Int, normals: Float, which: FillHoles, max_edges: int
) -> tuple[Int, Bool]:
    """Close holes of an oriented manifold.

    Parameters
    ----------
    vertices, normals : (V, 3), the normals point outside
    faces : (F, 3)
    which : "small" holes have at most `max_edges` edges and a filling that continues the surface
    max_edges : 0 leaves small holes open too

    Returns
    -------
    faces : (F', 3), those that close holes at the end
    closing : (F',) True for them

    """
    num = len(faces)
    if which != "none" and max_edges > 0 and num:
        faces = fill_holes(vertices, faces, normals, max_edges)
    if which == "all" and num:
        faces = close_all(vertices, faces)
    return faces, np.arange(len(faces)) >= num


def close_all(vertices: Float, faces: Int) -> Int:
    """Close every rim that has a triangulation without edges of the mesh: (F, 3) -> (F', 3)."""
    num = len(vertices)
    edges = set(directed_keys(faces, num).tolist())
    added: list[Int] = []
    for loop in boundary_loops(faces):
        patch = _spanned(vertices, loop, edges) if len(loop) >= 3 else None
        if patch is not None:
            added.append(patch)
            edges.update(directed_keys(patch, num).tolist())
    return np.concatenate([faces, *added]) if added else faces


def _spanned(vertices: Float, loop: Int, edges: set[int]) -> Int | None:
    """Triangles (n - 2, 3) across a closed loop of n vertices, or None where chords are taken."""
    if len(loop) <= MAX_CORNERS:
        triangles = best_triangulation(vertices[loop], _free(loop, edges, len(vertices)))
        return None if triangles is None else loop[triangles]
    at = np.unique(np.linspace(0, len(loop), MAX_CORNERS + 1).round().astype(np.int64))[:-1]
    parts = [_spanned(vertices, loop[at], edges)]
    for begin, end in zip(at, [*at[1:], len(loop)], strict=True):
        arc = np.append(loop[begin:end], loop[end % len(loop)])
        if len(arc) >= 3:
            parts.append(_spanned(vertices, arc, edges))
    whole = [part for part in parts if part is not None]
    return np.concatenate(whole) if len(whole) == len(parts) else None


def _free(loop: Int, edges: set[int], num: int) -> Bool:
    """Chords i < j of a loop that are no edge of the mesh yet: (n, n)."""
    i, j = np.triu_indices(len(loop), 1)
    pairs = zip(loop[i].tolist(), loop[j].tolist(), strict=True)
    taken = [a * num + b in edges or b * num + a in edges for a, b in pairs]
    free = np.ones((len(loop), len(loop)), dtype=bool)
    free[i, j] = ~np.array(taken, dtype=bool)
    return free
