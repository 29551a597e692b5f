"""Half-edges of a triangle mesh: neighbours, boundaries, connected pieces, fans.

Half-edge h = 3 f + k runs from corner k of face f to the next corner. A mesh is an oriented
2-manifold with boundary when every directed edge occurs once (so that an edge has at most two
faces, which agree on their outside) and the faces around each vertex form a single fan.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Int


def directed_keys(faces: Int, num_vertices: int) -> Int:
    """One number per half-edge, equal for equal start and end: (3 F,)."""
    start = faces.astype(np.int64).reshape(-1)
    end = np.roll(faces, -1, axis=1).astype(np.int64).reshape(-1)
    return np.asarray(start * num_vertices + end)


def next_in_face(halfedge: Int) -> Int:
    """The half-edge that follows in the same face."""
    return np.asarray(halfedge - halfedge % 3 + (halfedge % 3 + 1) % 3)


def opposite_halfedge(faces: Int) -> Int:
    """The half-edge that runs the other way along the same edge, or -1: (3 F,).

    The mesh is edge-manifold: an edge has two half-edges at most.
    """
    start = faces.astype(np.int64).reshape(-1)
    end = np.roll(faces, -1, axis=1).astype(np.int64).reshape(-1)
    # the two half-edges of an edge become neighbours, whichever comes first
    edge = np.minimum(start, end) * (int(faces.max(initial=0)) + 1) + np.maximum(start, end)
    order = np.argsort(edge)
    first, second = order[:-1], order[1:]
    paired = (edge[first] == edge[second]) & (start[first] == end[second])
    opposite = np.full(len(edge), -1, dtype=np.int64)
    opposite[first[paired]], opposite[second[paired]] = second[paired], first[paired]
    return opposite


def num_boundary_edges(faces: Int) -> int:
    """Edges with a face on one side only."""
    return int(np.sum(opposite_halfedge(faces) < 0))


def component_labels(faces: Int) -> Int:
    """The connected piece that each face belongs to: (F,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    opposite = opposite_halfedge(faces)
    h = np.flatnonzero(opposite >= 0)
    graph = coo_array(
        (np.ones(len(h), dtype=np.int8), (h // 3, opposite[h] // 3)), shape=(len(faces),) * 2
    )
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def vertex_fans(faces: Int) -> tuple[Int, Int]:
    """Faces over fans: (F, 3) numbers of fans, and the vertex that each fan lies at.

    Two corners at a vertex are in one fan when their faces share an edge there. Where a vertex has
    one fan this only renumbers; where two fans meet in a point it takes them apart.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    opposite = opposite_halfedge(faces)
    h = np.flatnonzero(opposite >= 0)
    g = opposite[h]
    row = np.concatenate([h, next_in_face(h)])
    col = np.concatenate([next_in_face(g), g])
    size = 3 * len(faces)
    graph = coo_array((np.ones(len(row), dtype=np.int8), (row, col)), shape=(size, size))
    num, label = connected_components(graph, directed=False)
    source = np.empty(num, dtype=np.int64)
    source[label] = faces.reshape(-1)
    return np.asarray(label, dtype=np.int64).reshape(-1, 3), source
