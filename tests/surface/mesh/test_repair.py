"""Half-edges, holes and repair of triangle meshes."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.mesh_normals import face_normals, vertex_normals
from semsfm_colmap.surface.mesh.halfedges import (
    component_labels,
    next_in_face,
    num_boundary_edges,
    opposite_halfedge,
    vertex_fans,
)
from semsfm_colmap.surface.mesh.holes import (
    best_triangulation,
    boundary_loops,
    fill_holes,
    triangle_cost,
)
from semsfm_colmap.surface.mesh.repair import (
    compact,
    drop_branches,
    drop_degenerate,
    drop_fins,
    drop_small_components,
    face_outside,
    repair,
)
from semsfm_colmap.types import Float, Int
from tests.oracles.surface import boundary_edges, is_edge_manifold, least_triangulation_cost

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def grid(n: int) -> tuple[Float, Int]:
    """A flat n x n sheet in z = 0 that faces +z."""
    y, x = np.mgrid[0:n, 0:n].astype(float)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + n])
    upper = np.column_stack([corner + 1, corner + n + 1, corner + n])
    return vertices, np.concatenate([lower, upper])


def up(vertices: Float) -> Float:
    return np.tile([0.0, 0.0, 1.0], (len(vertices), 1))


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


def test_a_hole_is_filled_and_the_rim_of_the_sheet_is_not() -> None:
    vertices, faces = grid(6)
    holed = faces[~np.isin(faces, [14, 15]).any(axis=1)]
    assert num_boundary_edges(holed) == 20 + 8
    filled = fill_holes(vertices, holed, up(vertices), 100)
    assert num_boundary_edges(filled) == 20
    assert is_edge_manifold(filled)
    assert face_normals(vertices, filled)[:, 2].min() > 0
    area = 0.5 * np.linalg.norm(face_normals(vertices, filled), axis=1).sum()
    assert area == pytest.approx(25.0)


def test_a_hole_with_too_many_edges_stays_open() -> None:
    vertices, faces = grid(6)
    holed = faces[~np.isin(faces, [14, 15]).any(axis=1)]
    assert len(fill_holes(vertices, holed, up(vertices), 7)) == len(holed)


def test_holes_that_touch_in_a_vertex_are_both_filled() -> None:
    vertices, faces = grid(7)
    holed = faces[~np.isin(faces, [16, 32]).any(axis=1)]
    filled = fill_holes(vertices, holed, up(vertices), 40)
    assert num_boundary_edges(filled) == 24
    assert all(len(np.unique(loop)) == len(loop) for loop in boundary_loops(holed))


def test_no_chord_that_is_an_edge_already_is_used() -> None:
    # a square hole whose diagonals both exist elsewhere in the mesh
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    free = np.ones((4, 4), dtype=bool)
    free[0, 2] = free[1, 3] = False
    assert best_triangulation(square, free) is None
    free[1, 3] = True
    triangles = best_triangulation(square, free)
    assert triangles is not None
    assert {1, 3} <= set(triangles[0].tolist()) & set(triangles[1].tolist())


@pytest.mark.parametrize("corners", [3, 4, 5, 6, 7])
def test_the_triangulation_has_the_least_cost_of_all(corners: int) -> None:
    polygon = np.random.default_rng(corners).normal(size=(corners, 3))
    triangles = best_triangulation(polygon)
    assert triangles is not None
    assert triangles.shape == (corners - 2, 3)
    cost = sum(float(triangle_cost(*polygon[t])) for t in triangles)
    assert cost == pytest.approx(least_triangulation_cost(polygon, 0.1))


def test_faces_without_area_and_repeated_faces_go() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 3], [0, 1, 2], [1, 1, 3], [3, 0, 1], [1, 2, 3]])
    np.testing.assert_array_equal(drop_degenerate(vertices, faces), [[0, 1, 3], [1, 2, 3]])


def test_of_three_faces_on_an_edge_the_one_with_the_longest_edge_goes() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 9]])
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    np.testing.assert_array_equal(drop_branches(vertices, faces), faces[:2])


def test_small_pieces_go_and_fins_go() -> None:
    faces = grid(5)[1]
    crumb = np.array([[25, 26, 27]])
    both = np.concatenate([faces, crumb])
    np.testing.assert_array_equal(drop_small_components(both, 0.1), faces)
    fin = np.array([[1, 0, 25]])
    trimmed = drop_fins(np.concatenate([faces, fin]), num_rounds=1)
    assert 25 not in trimmed


def test_repair_makes_a_soup_of_faces_an_oriented_manifold() -> None:
    vertices, faces = grid(8)
    rng = np.random.default_rng(0)
    flipped = np.where(rng.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    soup = np.concatenate([flipped, flipped[:5], [[0, 0, 1], [9, 10, 60]]])
    mended = repair(
        vertices, soup, cloud_normals=up(vertices), min_component_fraction=0.1, max_hole_edges=10
    )
    assert is_edge_manifold(mended)
    assert face_normals(vertices, mended)[:, 2].min() > 0
    np.testing.assert_allclose(vertex_normals(vertices, mended)[27], [0, 0, 1])


def test_turning_faces_outside_is_a_matter_of_their_vertices_normals() -> None:
    vertices, faces = grid(3)
    turned = face_outside(vertices, faces, -up(vertices))
    assert face_normals(vertices, turned)[:, 2].max() < 0


def test_an_empty_mesh_passes_through_repair() -> None:
    empty = np.zeros((0, 3), dtype=np.int64)
    vertices = grid(3)[0]
    mended = repair(
        vertices, empty, cloud_normals=up(vertices), min_component_fraction=0.1, max_hole_edges=10
    )
    assert mended.shape == (0, 3)
