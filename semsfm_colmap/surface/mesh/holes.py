"""Fill small holes of an oriented manifold mesh with triangulations of little area.

The boundary is followed by turning around each vertex from face to face, so that two holes that
meet in a vertex stay two loops. A loop with n edges is triangulated by dynamic programming over its
chords, O(n^3) (Barequet and Sharir 1995; Liepa 2003), which never uses a chord that is already an
edge of the mesh: that would make it branch.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.mesh.halfedges import directed_keys, next_in_face, opposite_halfedge
from semsfm_colmap.types import Bool, Float, Int

_SLIVER_WEIGHT = 0.1
_SMALL_LOOP = 12
"""Holes with so few edges are closed even by a lid, such as the tip of a needle."""
_MIN_LID_COSINE = 0.5
"""Cosine between a larger filling and the mean normal around it."""


def boundary_loops(faces: Int) -> list[Int]:
    """The holes' boundaries, in the direction that a filling face needs, no vertex twice in one."""
    opposite = opposite_halfedge(faces)
    boundary = np.flatnonzero(opposite < 0)
    following = next_in_face(boundary)
    turning = np.flatnonzero(opposite[following] >= 0)
    while len(turning):
        following[turning] = next_in_face(opposite[following[turning]])
        turning = turning[opposite[following[turning]] >= 0]
    successor = dict(zip(boundary.tolist(), following.tolist(), strict=True))
    start = faces.reshape(-1)
    loops = []
    while successor:
        first, h = successor.popitem()
        loop = [first]
        while h != first:
            loop.append(h)
            h = successor.pop(h)
        loops += _simple_loops(start[loop][::-1].tolist())
    return loops


def _simple_loops(loop: list[int]) -> list[Int]:
    """Cut a closed walk into loops that visit no vertex twice."""
    loops: list[Int] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for vertex in loop:
        if vertex in place:
            first = place[vertex]
            loops.append(np.array(path[first:]))
            for left in path[first + 1 :]:
                del place[left]
            del path[first + 1 :]
        else:
            place[vertex] = len(path)
            path.append(vertex)
    return [*loops, np.array(path)] if len(path) > 1 else loops


def fill_holes(vertices: Float, faces: Int, normals: Float, max_edges: int) -> Int:
    """Close the holes with at most `max_edges` edges whose filling continues the surface.

    The filling of a hole in a surface faces the way the surface around it does; a lid across the
    open end of a tube or a bowl stands at a right angle to it, and only a small one is wanted.

    Parameters
    ----------
    vertices, normals : (V, 3), the normals point outside
    faces : (F, 3) edge-manifold and oriented

    Returns
    -------
    (F', 3) with the new faces at the end

    """
    num = len(vertices)
    edges = set(directed_keys(faces, num).tolist())
    added: list[Int] = []
    for loop in boundary_loops(faces):
        if not 3 <= len(loop) <= max_edges:
            continue
        i, j = np.triu_indices(len(loop), 1)
        lo, hi = loop[i], loop[j]
        taken = [
            a * num + b in edges or b * num + a in edges
            for a, b in zip(lo.tolist(), hi.tolist(), strict=True)
        ]
        free = np.ones((len(loop), len(loop)), dtype=bool)
        free[i, j] = ~np.array(taken)
        triangles = best_triangulation(vertices[loop], free)
        if triangles is None:
            continue
        patch = loop[triangles]
        corner = vertices[patch]
        area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(axis=0)
        cosine = normals[loop].mean(axis=0) @ area / max(float(np.linalg.norm(area)), 1e-300)
        if cosine <= (0.0 if len(loop) <= _SMALL_LOOP else _MIN_LID_COSINE):
            continue
        added.append(patch)
        edges.update(directed_keys(patch, num).tolist())
    return np.concatenate([faces, *added]) if added else faces


def best_triangulation(polygon: Float, free: Bool | None = None) -> Int | None:
    """Triangulate a closed polygon in space with little area and no slivers.

    ``W[i, j] = min_k W[i, k] + W[k, j] + w(i, k, j)`` for the part of the polygon between the
    corners i < j, where w is the triangle's area plus a tenth of its squared longest edge: area
    alone cannot tell the triangulations of a flat polygon apart, and picks slivers.

    Parameters
    ----------
    polygon : (n, 3), n >= 3
    free : (n, n) bool, which chords i < j may be used; the polygon's own edges always may

    Returns
    -------
    (n - 2, 3) corners in the polygon's direction, or None when the chords do not suffice

    """
    n = len(polygon)
    cost = np.zeros((n, n))
    split = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        i = np.arange(n - span)
        j = i + span
        k = i[:, None] + np.arange(1, span)
        total = cost[i[:, None], k] + cost[k, j[:, None]]
        total += triangle_cost(polygon[i, None], polygon[k], polygon[j, None])
        best = np.argmin(total, axis=1)
        cost[i, j], split[i, j] = total[i, best], k[i, best]
        if free is not None and span < n - 1:
            cost[i, j] = np.where(free[i, j], cost[i, j], np.inf)
    if not np.isfinite(cost[0, n - 1]):
        return None
    triangles: list[tuple[int, int, int]] = []
    open_parts: list[tuple[int, int]] = [(0, n - 1)]
    while open_parts:
        low, high = open_parts.pop()
        if high - low < 2:
            continue
        middle = int(split[low, high])
        triangles.append((low, middle, high))
        open_parts += [(low, middle), (middle, high)]
    return np.array(triangles, dtype=np.int64)


def triangle_cost(a: Float, b: Float, c: Float) -> Float:
    """Area plus a share of the squared longest edge; shapes broadcast: (..., 3) -> (...)."""
    u, v = b - a, c - a
    uu, vv, uv = (np.einsum("...i,...i->...", p, q) for p, q in ((u, u), (v, v), (u, v)))
    # |u x v|^2 = u^2 v^2 - (u . v)^2, and the third edge is v - u
    area = 0.5 * np.sqrt(np.maximum(uu * vv - uv**2, 0.0))
    return np.asarray(area + _SLIVER_WEIGHT * np.maximum(np.maximum(uu, vv), uu + vv - 2.0 * uv))
