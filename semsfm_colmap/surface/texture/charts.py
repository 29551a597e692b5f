"""Charts of a mesh and the atlas that they are packed into.

Under parallel projection a chart is best what a camera sees: connected faces that look roughly the
same way, projected along their mean normal. The directions are those to the faces and corners of a
cube; each face takes one that it looks along, and agrees with its neighbours where that costs
little (a Potts model). Where a chart would lie over itself, as the turns of a spiral do, the upper
layer becomes a chart of its own. Packing is xatlas's.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.io.extras import import_extra
from semsfm_colmap.surface.mesh.halfedges import opposite_halfedge
from semsfm_colmap.surface.texture.chart_kernels import overlapping, smooth_labels
from semsfm_colmap.types import Float, Int

_AGREEMENT = 0.4
"""How much cosine a face gives up for each neighbour that it agrees with."""
_MIN_COSINE = 0.2
"""Between a face and the direction of its chart: it keeps this share of its area."""
_NUM_ROUNDS = 30
_SMALL = 16
"""Charts of fewer faces join a neighbour where all of them may look along its direction."""
BORDER_TEXELS = 2.0
"""Width of the border around each chart; the packer keeps charts twice as far apart."""


def make_atlas(
    vertices: Float, faces: Int, unit: float, max_size: int
) -> tuple[Float, tuple[int, int]]:
    """Texture coordinates (F, 3, 2), 0 to 1 with the origin bottom left; the width and height.

    Parameters
    ----------
    vertices, faces : (V, 3), (F, 3) with F >= 1
    unit : length that gets a texel where a chart is flat
    max_size : of both sides of the texture, texels; a larger atlas is shrunk to it

    Raises
    ------
    UsageError
        Where the borders of the charts alone are larger.

    """
    chart = make_charts(vertices, faces, unit)
    flat = project_charts(vertices / unit, faces, chart)
    texels_per_unit, before = 1.0, np.inf
    while True:
        uv, size = _pack(flat * texels_per_unit, faces, chart)
        if max(size) <= max_size:
            return uv, size
        if max(size) >= before:  # nothing but borders is left, which do not shrink with the charts
            break
        before = max(size)
        texels_per_unit *= 0.95 * max_size / before
    raise UsageError(
        f"the {chart.max() + 1} charts of the mesh do not fit into a texture of {max_size} px: "
        "raise surface.max_texture_size_px, or lower surface.max_texture_faces."
    )


def make_charts(vertices: Float, faces: Int, unit: float) -> Int:
    """The chart of each face, numbered from 0: (F,).

    A chart is connected over edges and its projection covers no texel twice.
    """
    normal = _unit(face_normals(vertices, faces))
    opposite = opposite_halfedge(faces).reshape(-1, 3)
    neighbor = np.where(opposite >= 0, opposite // 3, -1)
    cosine = normal @ _directions().T
    cosine[~normal.any(axis=1)] = 1.0  # a face without area may look anywhere
    label = smooth_labels(cosine, neighbor, _AGREEMENT, _MIN_COSINE, _NUM_ROUNDS)
    label = _without_small(label, cosine, neighbor)
    chart = _connected(label, neighbor)
    while True:
        order = np.argsort(chart, kind="stable")
        start = np.searchsorted(chart[order], np.arange(chart.max() + 2))
        upper = overlapping(project_charts(vertices / unit, faces, chart), order, start)
        if not upper.any():
            return chart
        chart = _connected(2 * chart + upper, neighbor)


def project_charts(vertices: Float, faces: Int, chart: Int) -> Float:
    """Corners (F, 3, 2) on the planes across the charts' mean normals.

    Where a face would look along its mean normal by less than it may, the chart takes the nearest
    of the module's directions instead, which all its faces have.
    """
    weighted = face_normals(vertices, faces)
    normal = _unit(weighted)
    mean = _unit(np.stack([np.bincount(chart, weighted[:, k]) for k in range(3)], axis=1))
    lowest = np.full(len(mean), np.inf)
    np.minimum.at(lowest, chart, np.einsum("ij,ij->i", normal, mean[chart]))
    directions = _directions()
    worst = np.full((len(mean), len(directions)), np.inf)
    np.minimum.at(worst, chart, normal @ directions.T)
    steep = lowest < _MIN_COSINE
    mean[steep] = directions[np.argmax(worst[steep], axis=1)]
    helper = np.where(np.abs(mean[:, :1]) > 0.7, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    right = _unit(np.cross(helper, mean))
    up = np.cross(mean, right)
    corner = vertices[faces]
    return np.stack([np.einsum("fki,fi->fk", corner, axis[chart]) for axis in (right, up)], axis=-1)


def _directions() -> Float:
    """Unit vectors to the faces and corners of a cube: (14, 3)."""
    lattice: Float = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
    return _unit(lattice[np.isin(np.abs(lattice).sum(axis=1), (1, 3))])


def _without_small(label: Int, cosine: Float, neighbor: Int) -> Int:
    """Labels where small connected pieces have that of the neighbours they touch most."""
    for _ in range(_NUM_ROUNDS):
        piece = _connected(label, neighbor)
        num = piece.max() + 1
        face, side = np.nonzero(neighbor >= 0)
        votes = np.zeros((num, cosine.shape[1]))
        np.add.at(votes, (piece[face], label[neighbor[face, side]]), 1.0)
        lowest = np.full(votes.shape, np.inf)
        np.minimum.at(lowest, piece, cosine)
        votes[lowest < _MIN_COSINE] = 0.0
        own = np.empty(num, dtype=np.int64)
        own[piece] = label
        votes[np.arange(num), own] = 0.0  # edges within the piece
        joins = (np.bincount(piece) < _SMALL) & (votes.max(axis=1) > 0)
        if not joins.any():
            break
        moved = np.where(joins, votes.argmax(axis=1), own)
        label = moved[piece]
    return label


def _connected(label: Int, neighbor: Int) -> Int:
    """Connected pieces of faces with the same label, numbered from 0: (F,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    face, side = np.nonzero(neighbor >= 0)
    other = neighbor[face, side]
    same = label[face] == label[other]
    graph = coo_array(
        (np.ones(int(same.sum()), dtype=np.int8), (face[same], other[same])),
        shape=(len(label),) * 2,
    )
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _pack(flat: Float, faces: Int, chart: Int) -> tuple[Float, tuple[int, int]]:
    """Charts in texels, put side by side: coordinates in 0..1, width and height."""
    xatlas = import_extra("xatlas", "mesh")
    key = chart[:, None] * (faces.max() + 1) + faces
    _, first, corner = np.unique(key, return_index=True, return_inverse=True)
    place = flat.reshape(-1, 2)[first]
    place = place - place.min(axis=0)
    atlas = xatlas.Atlas()
    atlas.add_uv_mesh(
        place.astype(np.float32),
        corner.reshape(-1, 3).astype(np.uint32),
        chart[:, None].astype(np.uint32),
    )
    packing = xatlas.PackOptions()
    packing.texels_per_unit = 1.0
    packing.padding = int(2 * BORDER_TEXELS)
    packing.bilinear = True
    atlas.generate(xatlas.ChartOptions(), packing)
    _, packed, uv = atlas[0]
    return np.asarray(uv, dtype=np.float64)[packed.astype(np.int64)], (atlas.width, atlas.height)


def _unit(v: Float) -> Float:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0))
