"""Holes of sheets are filled, and only holes."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.halfedges import (
    num_boundary_edges,
)
from semsfm_colmap.surface.mesh.holes import (
    best_triangulation,
    boundary_loops,
    fill_holes,
    triangle_cost,
)
from tests.oracles.surface import is_edge_manifold, least_triangulation_cost
from tests.surface.mesh.sheets import grid, up


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
