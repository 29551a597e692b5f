"""Neighbours, boundaries, pieces and fans of small meshes."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.mesh.halfedges import (
    component_labels,
    next_in_face,
    num_boundary_edges,
    opposite_halfedge,
    vertex_fans,
)
from semsfm_colmap.surface.mesh.holes import (
    boundary_loops,
)
from semsfm_colmap.surface.mesh.repair import (
    compact,
)
from tests.oracles.surface import boundary_edges
from tests.surface.mesh.sheets import grid

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_opposite_halfedges_run_the_other_way() -> None:
    faces = grid(5)[1]
    opposite = opposite_halfedge(faces)
    start = faces.reshape(-1)
    end = start[next_in_face(np.arange(len(start)))]
    paired = np.flatnonzero(opposite >= 0)
    np.testing.assert_array_equal(start[paired], end[opposite[paired]])
    assert num_boundary_edges(faces) == len(boundary_edges(faces)) == 16


def test_a_closed_surface_has_no_boundary() -> None:
    assert num_boundary_edges(TETRAHEDRON) == 0
    assert boundary_loops(TETRAHEDRON) == []


def test_pieces_are_joined_over_edges_not_over_vertices() -> None:
    faces = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 5]])
    label = component_labels(faces)
    assert label[0] == label[1] != label[2]


def test_two_fans_at_one_vertex_are_taken_apart() -> None:
    vertices = np.arange(15.0).reshape(5, 3)
    colors = np.arange(15, dtype=np.uint8).reshape(5, 3)
    faces = np.array([[0, 1, 2], [2, 3, 4]])
    new_vertices, new_faces, new_colors = compact(vertices, faces, colors)
    assert len(new_vertices) == 6
    np.testing.assert_array_equal(new_vertices[new_faces], vertices[faces])
    assert new_colors is not None
    np.testing.assert_array_equal(new_colors[new_faces], colors[faces])


def test_a_manifold_mesh_keeps_its_vertices() -> None:
    fans, source = vertex_fans(TETRAHEDRON)
    assert len(source) == 4
    np.testing.assert_array_equal(source[fans], TETRAHEDRON)
