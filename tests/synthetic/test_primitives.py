"""Bodies are closed, turn their outside out and have the size they should."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.primitives import Mesh, geodesic_sphere, grid_faces, merged, tube


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh[0][mesh[1][:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def assert_closed(mesh: Mesh) -> None:
    """Every edge is run through once in either direction."""
    f = mesh[1]
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    forward = {tuple(e) for e in edges.tolist()}
    assert len(forward) == len(edges)
    assert forward == {(b, a) for a, b in forward}


@pytest.mark.parametrize("segments", [1, 2, 5, 16])
def test_a_geodesic_sphere_has_the_counts_of_its_formula_and_is_closed(segments: int) -> None:
    mesh = geodesic_sphere(segments)
    assert mesh[0].shape == (10 * segments**2 + 2, 3)
    assert mesh[1].shape == (20 * segments**2, 3)
    assert_closed(mesh)


def test_a_fine_geodesic_sphere_has_the_volume_of_a_ball() -> None:
    assert volume(geodesic_sphere(24)) == pytest.approx(4.0 * np.pi / 3.0, rel=2e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_straight_tube_is_a_closed_cylinder_turned_outside_out(axis: int) -> None:
    line = np.zeros((9, 3))
    line[:, axis] = np.linspace(-1.0, 1.0, 9)
    mesh = tube(line, np.full(9, 0.5), 60)
    assert_closed(mesh)
    assert volume(mesh) == pytest.approx(np.pi * 0.25 * 2.0, rel=3e-3)


def test_a_grid_faces_up_where_rows_grow_right_and_columns_up() -> None:
    x, y = np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    faces = grid_faces(3, 4)
    assert len(faces) == 2 * 2 * 3
    np.testing.assert_allclose(vertex_normals(vertices, faces), [[0.0, 0.0, 1.0]] * 12)


def test_merging_keeps_every_part() -> None:
    ball = geodesic_sphere(2)
    moved = (ball[0] + [5.0, 0.0, 0.0], ball[1])
    both = merged([ball, moved])
    assert volume(both) == pytest.approx(2.0 * volume(ball))
    assert_closed(both)
