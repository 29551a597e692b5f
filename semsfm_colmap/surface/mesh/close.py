"""Close every hole of an oriented manifold mesh, so that it bounds a body.

The rim of a sheet seen from one side is no hole in it: a lid across it would lie on the sheet.
Where the faces' area vectors do not cancel (``|sum a_i| / sum |a_i|`` is 0 for a closed surface, 1
for a flat sheet) the longest rim gets a wall down to a plane below the lowest vertex and a floor.
All other holes are spanned in place by triangulations of little area (`holes.py`). A rim with many
edges is first spanned between some of its corners, evenly chosen, and then between neighbouring
ones of these, so that the cost stays near that of the small polygon. Where no triangles can be had
without an edge that the mesh has already, or without needles along a straight rim, a new vertex in
the middle of the rim is joined to all of it.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.halfedges import directed_keys
from semsfm_colmap.surface.mesh.holes import best_triangulation, boundary_loops
from semsfm_colmap.surface.mesh.repair import MIN_HEIGHT, part_touching
from semsfm_colmap.types import Array, Bool, Float, Int

SHEET_RATIO = 0.5
"""Above this a surface is a sheet with a rim: half a ball has 0.5."""
FLOOR_DEPTH = 0.1
"""The floor lies this share of the sheet's extent below its lowest vertex."""
MAX_CORNERS = 200
"""Rims with more edges are spanned between so many of their corners first."""
MAX_ROUNDS = 6
"""Attempts to span a rim without needles."""


def close_holes(
    vertices: Float, faces: Int, colors: Array | None
) -> tuple[Float, Int, Array | None]:
    """Faces and vertices with all rims closed; new vertices have the colour of the nearest one.

    Vertices in one place part, so that the body is closed also to who joins them (`part_touching`).

    Parameters
    ----------
    vertices : (V, 3)
    faces : (F, 3) oriented, one fan at each vertex
    colors : (V, 3) or None

    """
    loops = boundary_loops(faces)
    if not loops:
        return vertices, faces, colors
    vertices = part_touching(vertices, faces)
    source = np.arange(len(vertices))
    area = face_normals(vertices, faces)
    ratio = np.linalg.norm(area.sum(axis=0)) / np.linalg.norm(area, axis=1).sum()
    if ratio > SHEET_RATIO:
        loops.sort(key=lambda loop: _length(vertices[loop]))
        rim = loops.pop()
        vertices, wall = _wall(vertices, rim, area.sum(axis=0))
        faces = np.concatenate([faces, wall])
        loops.append(np.arange(len(source), len(vertices)))
        source = np.concatenate([source, rim])
    edges = set(directed_keys(faces, len(vertices)).tolist())
    added = [faces]
    for loop in loops:
        patch = _span_without_needles(vertices, loop, edges)
        if patch is None:
            vertices = np.concatenate([vertices, vertices[loop].mean(axis=0, keepdims=True)])
            middle = np.full(len(loop), len(vertices) - 1)
            source = np.append(source, source[loop[0]])
            patch = np.column_stack([loop, np.roll(loop, -1), middle])
            # keys count vertices: they are made anew
            edges = set(directed_keys(np.concatenate(added), len(vertices)).tolist())
        edges.update(directed_keys(patch, len(vertices)).tolist())
        added.append(patch)
    return vertices, np.concatenate(added), None if colors is None else colors[source]


def _wall(vertices: Float, rim: Int, area: Float) -> tuple[Float, Int]:
    """Vertices of a floor's edge below a rim, and the faces between the two."""
    up = area / np.linalg.norm(area)
    height = vertices @ up
    floor = height.min() - FLOOR_DEPTH * float(np.ptp(vertices, axis=0).max())
    below = vertices[rim] + (floor - height[rim])[:, None] * up
    lower = np.arange(len(vertices), len(vertices) + len(rim))
    after, lower_after = np.roll(rim, -1), np.roll(lower, -1)
    faces = np.concatenate(
        [np.column_stack([rim, after, lower]), np.column_stack([after, lower_after, lower])]
    )
    return np.concatenate([vertices, below]), faces


def _span_without_needles(vertices: Float, loop: Int, edges: set[int]) -> Int | None:
    """`_span`, again without the longest edges of what came out as needles; None: they stay."""
    banned = set(edges)
    for _ in range(MAX_ROUNDS):
        patch = _span(vertices, loop, banned)
        if patch is None:
            return None
        corner = vertices[patch]
        side = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
        # twice the area over the longest side is the height
        double_area = np.linalg.norm(face_normals(vertices, patch), axis=1)
        needle = np.flatnonzero(double_area <= MIN_HEIGHT * side.max(axis=1) ** 2)
        if len(needle) == 0:
            return patch
        longest = side[needle].argmax(axis=1)
        start, end = patch[needle, longest], patch[needle, (longest + 1) % 3]
        banned.update((start * len(vertices) + end).tolist())
    return None


def _span(vertices: Float, loop: Int, edges: set[int]) -> Int | None:
    """Triangles across a rim, none of whose inner edges the mesh has already; None: there are none.

    Parameters
    ----------
    loop : (n,) vertices in the direction that the new faces need
    edges : keys of the directed edges of the mesh (`directed_keys`)

    """
    n = len(loop)
    if n > MAX_CORNERS:
        corner = np.linspace(0, n, MAX_CORNERS, endpoint=False).astype(np.int64)
        bridging = np.diff(np.append(corner, n)) > 1
        patches = [_polygon(vertices, loop[corner], edges, bridging)]
        for k, first in enumerate(corner):
            last = corner[k + 1] if k + 1 < len(corner) else n
            part = np.append(loop[first:last], loop[last % n])
            if len(part) > 2:
                patches.append(_span(vertices, part, edges))
        if any(patch is None for patch in patches):
            return None
        return np.concatenate([patch for patch in patches if patch is not None])
    return _polygon(vertices, loop, edges, np.zeros(n, dtype=bool))


def _polygon(vertices: Float, loop: Int, edges: set[int], bridging: Bool) -> Int | None:
    """The cheapest triangles of a polygon none of whose chords the mesh has.

    Parameters
    ----------
    loop : (n,)
    bridging : (n,) which sides, from each vertex to the next, are chords as well

    """
    n, num = len(loop), len(vertices)
    i, j = np.triu_indices(n, 1)
    lo, hi = loop[i], loop[j]
    taken = [
        a * num + b in edges or b * num + a in edges
        for a, b in zip(lo.tolist(), hi.tolist(), strict=True)
    ]
    free: Bool = np.ones((n, n), dtype=bool)
    free[i, j] = ~np.array(taken)
    begin = np.flatnonzero(bridging)
    end = (begin + 1) % n
    if not free[np.minimum(begin, end), np.maximum(begin, end)].all():
        return None
    triangles = best_triangulation(vertices[loop], free)
    return None if triangles is None else loop[triangles]


def _length(polygon: Float) -> float:
    return float(np.linalg.norm(polygon - np.roll(polygon, -1, axis=0), axis=1).sum())
