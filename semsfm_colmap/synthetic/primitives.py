"""Triangle meshes of simple bodies: spheres, tubes, swept outlines, sheets.

Faces are counter-clockwise seen from outside.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int

Mesh = tuple[Float, Int]
"""vertices (V, 3), faces (F, 3)"""

SPHERE_EDGE = 1.2
"""Mean edge length of `geodesic_sphere(1)`, in radii; it falls as 1 / segments."""
GOLDEN = (1.0 + 5.0**0.5) / 2.0
# fmt: off
ICOSAHEDRON_CORNERS = np.array([
    [-1, GOLDEN, 0], [1, GOLDEN, 0], [-1, -GOLDEN, 0], [1, -GOLDEN, 0],
    [0, -1, GOLDEN], [0, 1, GOLDEN], [0, -1, -GOLDEN], [0, 1, -GOLDEN],
    [GOLDEN, 0, -1], [GOLDEN, 0, 1], [-GOLDEN, 0, -1], [-GOLDEN, 0, 1],
])
ICOSAHEDRON_FACES = np.array([
    [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
    [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
    [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
    [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
])
# fmt: on


def geodesic_sphere(segments: int) -> Mesh:
    """Unit sphere: each face of an icosahedron split into `segments`^2, pushed to the sphere.

    Returns
    -------
    vertices (10 segments^2 + 2, 3), faces (20 segments^2, 3)

    """
    corners, base = ICOSAHEDRON_CORNERS, ICOSAHEDRON_FACES
    n = segments
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    keep = i + j <= n
    number = np.full((n + 1, n + 1), -1)
    number[keep] = np.arange(keep.sum())
    a, b = i[keep] / n, j[keep] / n
    weights = np.stack([1.0 - a - b, a, b], axis=1)
    vertices = np.einsum("wk,fkx->fwx", weights, corners[base]).reshape(-1, 3)
    cell = (i + j)[:-1, :-1]
    up = np.stack([number[:-1, :-1], number[1:, :-1], number[:-1, 1:]], axis=-1)[cell < n]
    down = np.stack([number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)[cell < n - 1]
    local = np.concatenate([up, down])
    faces = (local[None] + (np.arange(20) * keep.sum())[:, None, None]).reshape(-1, 3)
    # The faces of the icosahedron share their borders: merge the vertices that coincide.
    _, first, merged = np.unique(
        np.round(vertices, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    vertices = vertices[first]
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices, np.asarray(merged.reshape(-1)[faces], dtype=np.int64)


def grid_faces(rows: int, columns: int, *, closed: bool = False) -> Int:
    """Triangles between the vertices of a grid numbered row by row.

    Seen with rows growing to the right and columns growing up they are counter-clockwise;
    `closed` joins the last column to the first.
    """
    r = np.arange(rows - 1)[:, None]
    c = np.arange(columns if closed else columns - 1)[None]
    a, b = r * columns + c, (r + 1) * columns + c
    d, e = r * columns + (c + 1) % columns, (r + 1) * columns + (c + 1) % columns
    faces = np.stack([np.stack([a, b, e], axis=-1), np.stack([a, e, d], axis=-1)])
    return np.asarray(faces.reshape(-1, 3), dtype=np.int64)


def sweep(line: Float, outlines: Float) -> Mesh:
    """Body of closed outlines placed along a line, with flat ends.

    Parameters
    ----------
    line : (L, 3) positions
    outlines : (L, K, 3) offsets from them, clockwise seen along the line

    Returns
    -------
    vertices (L K + 2, 3), faces

    """
    L, K = outlines.shape[:2]
    vertices = np.concatenate([(line[:, None] + outlines).reshape(-1, 3), line[:1], line[-1:]])
    k = np.arange(K)
    start = np.stack([np.full(K, L * K), k, (k + 1) % K], axis=1)
    last = (L - 1) * K
    end = np.stack([np.full(K, L * K + 1), last + (k + 1) % K, last + k], axis=1)
    return vertices, np.concatenate([grid_faces(L, K, closed=True), start, end])


def tube(line: Float, radii: Float, num_around: int) -> Mesh:
    """Round tube of varying radius along a line that does not turn back on itself.

    Parameters
    ----------
    line : (L, 3)
    radii : (L,)
    num_around : vertices of each ring

    """
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # The coordinate axis farthest from the tube's direction keeps the rings from twisting.
    side = np.eye(3)[np.argmin(np.abs(tangent[len(line) // 2]))]
    e1 = np.cross(tangent, side)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(tangent, e1)
    angle = -2.0 * np.pi * np.arange(num_around) / num_around
    ring = np.cos(angle)[:, None] * e1[:, None] + np.sin(angle)[:, None] * e2[:, None]
    return sweep(line, radii[:, None, None] * ring)


def merged(meshes: list[Mesh]) -> Mesh:
    """One mesh of several, vertices and faces in their order."""
    offsets = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    faces = np.concatenate([f + k for (_, f), k in zip(meshes, offsets, strict=True)])
    return np.concatenate([v for v, _ in meshes]), faces
