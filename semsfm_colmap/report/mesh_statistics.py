"""Size and soundness of a triangle mesh, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float, TriangleMesh


@dataclass(frozen=True, kw_only=True)
class BoundingBox:
    """Along the world axes, of the vertices that faces use."""

    min_world: tuple[float, ...]
    max_world: tuple[float, ...]
    size_world: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class MeshMetrics:
    """Counts, area and box of a mesh."""

    num_vertices: int
    num_faces: int
    num_components: int
    """pieces that share no vertex"""
    num_open_edges: int
    """edges of one face only; a closed surface has none"""
    area_world2: float
    largest_component_area_fraction: float | None
    """None when the faces have no area"""
    bounding_box: BoundingBox | None
    """None without a face"""


def face_areas(mesh: TriangleMesh) -> Float:
    """(F,) areas in world units squared."""
    corner = mesh.vertices[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.asarray(0.5 * np.linalg.norm(normal, axis=1))


def mesh_statistics(mesh: TriangleMesh) -> MeshMetrics:
    """Counts, components, open edges, area and bounding box of the vertices that faces use.

    A component is a set of faces joined through shared vertices. An edge is open when only one
    face has it: a closed surface has none.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if len(mesh.faces) == 0:
        return MeshMetrics(
            num_vertices=len(mesh.vertices),
            num_faces=0,
            num_components=0,
            num_open_edges=0,
            area_world2=0.0,
            largest_component_area_fraction=None,
            bounding_box=None,
        )
    faces = np.asarray(mesh.faces, dtype=np.int64)
    num_vertices = len(mesh.vertices)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    graph = coo_array(
        (np.ones(len(edges), dtype=np.int32), (edges[:, 0], edges[:, 1])),
        shape=(num_vertices, num_vertices),
    )
    label = connected_components(graph, directed=False)[1]
    area = face_areas(mesh)
    area_of_component = np.bincount(label[faces[:, 0]], weights=area)
    _, edge_count = np.unique(edges[:, 0] * num_vertices + edges[:, 1], return_counts=True)
    used = mesh.vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    total = float(area.sum())
    return MeshMetrics(
        num_vertices=num_vertices,
        num_faces=len(faces),
        num_components=len(np.unique(label[faces[:, 0]])),
        num_open_edges=int(np.sum(edge_count == 1)),
        area_world2=total,
        largest_component_area_fraction=float(area_of_component.max() / total)
        if total > 0.0
        else None,
        bounding_box=BoundingBox(
            min_world=tuple(low.tolist()),
            max_world=tuple(high.tolist()),
            size_world=tuple((high - low).tolist()),
        ),
    )
