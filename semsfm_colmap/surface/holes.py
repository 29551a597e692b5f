"""Fill small holes of an oriented manifold mesh with triangulations of least area.

The boundary is followed by turning around each vertex from face to face, so that two holes that
meet in a vertex stay two loops. A loop with n edges is triangulated by dynamic programming over its
chords, O(n^3) (Barequet and Sharir 1995; Liepa 2003), which never uses a chord that is already an
edge of the mesh: that would make it branch.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.halfedges import directed_keys, next_in_face, opposite_halfedge
from semsfm_colmap.types import Float, Int


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
    """Close the holes with at most `max_edges` edges whose filling faces outside.

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
        triangles = least_area_triangulation(vertices[loop], free)
        if triangles is None:
            continue
        patch = loop[triangles]
        corner = vertices[patch]
        area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(axis=0)
        if area @ normals[loop].sum(axis=0) <= 0:
            continue
        added.append(patch)
        edges.update(directed_keys(patch, num).tolist())
    return np.concatenate([faces, *added]) if added else faces


def least_area_triangulation(polygon: Float, free: Int | None = None) -> Int | None:
    """Triangulate a closed polygon in space with the least total area.

    ``W[i, j] = min_k W[i, k] + W[k, j] + area(i, k, j)`` for the part of the polygon between the
    corners i < j.

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
        for i in range(n - span):
            j = i + span
            if free is not None and span < n - 1 and not free[i, j]:
                cost[i, j] = np.inf
                continue
            k = np.arange(i + 1, j)
            area = 0.5 * np.linalg.norm(
                np.cross(polygon[k] - polygon[i], polygon[j] - polygon[i]), axis=1
            )
            total = cost[i, k] + cost[k, j] + area
            best = int(np.argmin(total))
            cost[i, j], split[i, j] = total[best], k[best]
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
