"""Which holes are closed, and that the closing faces are marked."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.mesh.fill import MAX_CORNERS, FillHoles, close_all, filled
from semsfm_colmap.surface.mesh.halfedges import num_boundary_edges
from semsfm_colmap.types import Float, Int
from tests.oracles.surface import is_edge_manifold
from tests.surface.mesh.sheets import grid, up


def open_cylinder(around: int, along: int) -> tuple[Float, Int]:
    """A tube of radius 1 and length 2, its faces outside, open at both ends."""
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    vertices = np.concatenate(
        [np.column_stack([ring, np.full(around, z)]) for z in np.linspace(-1.0, 1.0, along)]
    )
    i, k = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = i * around + k, i * around + (k + 1) % around
    faces = np.concatenate(
        [np.stack([a, b, b + around], axis=-1), np.stack([a, b + around, a + around], axis=-1)]
    )
    return vertices, faces.reshape(-1, 3)


def volume(vertices: Float, faces: Int) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(("which", "rim"), [("none", 28), ("small", 20), ("all", 0)])
def test_holes_are_closed_as_asked_and_what_closes_them_is_marked(
    which: FillHoles, rim: int
) -> None:
    vertices, faces = grid(6)
    holed = faces[~np.isin(faces, [14, 15]).any(axis=1)]
    closed, closing = filled(vertices, holed, up(vertices), which, 10)
    assert num_boundary_edges(closed) == rim
    assert is_edge_manifold(closed)
    np.testing.assert_array_equal(closed[~closing], holed)
    assert closing.sum() == len(closed) - len(holed)


@pytest.mark.parametrize("around", [12, MAX_CORNERS, MAX_CORNERS + 1, 300])
def test_a_tube_with_long_rims_becomes_a_body_of_the_right_volume(around: int) -> None:
    vertices, faces = open_cylinder(around, 5)
    closed = close_all(vertices, faces)
    assert num_boundary_edges(closed) == 0
    assert is_edge_manifold(closed)
    # the prism over a regular polygon of unit circumradius, 2 long
    expected = around * np.sin(2.0 * np.pi / around)
    assert volume(vertices, closed) == pytest.approx(expected, rel=1e-9)


def test_a_mesh_without_faces_stays_one() -> None:
    vertices, faces = grid(3)
    closed, closing = filled(vertices, faces[:0], up(vertices), "all", 10)
    assert len(closed) == len(closing) == 0
