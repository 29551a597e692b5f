"""A soup of triangles becomes an oriented manifold."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.geometry.mesh_normals import face_normals, vertex_normals
from semsfm_colmap.surface.mesh.repair import (
    PARTING,
    drop_branches,
    drop_degenerate,
    face_outside,
    in_large_components,
    not_fins,
    part_touching,
    repair,
    welded,
    worth_keeping,
)
from semsfm_colmap.types import Float, Int, TriangleMesh
from tests.oracles.sound_mesh import assert_sound
from tests.oracles.surface import is_edge_manifold
from tests.surface.mesh.sheets import grid, up


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
    crumb = np.array([[26, 27, 28], [26, 28, 29], [27, 26, 30], [28, 27, 31]])
    fin = np.array([[1, 0, 25]])
    soup = np.concatenate([faces, fin, crumb])
    keep = worth_keeping(soup, 0.2, 100)
    assert not keep[len(faces) :].any()
    # the other corners of the sheet hang on by one edge too
    assert keep.sum() == len(faces) - 1
    assert not_fins(soup)[len(faces) + 1 :].sum() == 1


def test_pieces_of_enough_faces_stay_beside_one_of_any_size() -> None:
    large, small = grid(40)[1], grid(5)[1]
    both = np.concatenate([large, small + large.max() + 1])
    assert in_large_components(both, 0.1).sum() == len(large)
    assert in_large_components(both, 0.1, len(small)).all()
    assert in_large_components(both, 0.1, len(small) + 1).sum() == len(large)


def test_repair_makes_a_soup_of_faces_an_oriented_manifold() -> None:
    vertices, faces = grid(8)
    rng = np.random.default_rng(0)
    flipped = np.where(rng.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    soup = np.concatenate([flipped, flipped[:5], [[0, 0, 1], [9, 10, 60]]])
    mended = repair(vertices, soup, cloud_normals=up(vertices))
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
    mended = repair(vertices, empty, cloud_normals=up(vertices))
    assert mended.shape == (0, 3)


def hourglass() -> tuple[Float, Int]:
    """Two cones without floors, their tips in one place."""
    around = np.radians(np.arange(8) * 45.0)
    ring = np.column_stack([np.cos(around), np.sin(around), np.ones(8)])
    up = np.array([[8, k, (k + 1) % 8] for k in range(8)])
    cone = np.concatenate([ring, np.zeros((1, 3))])
    vertices = np.concatenate([cone, cone * [1.0, 1.0, -1.0]])
    return vertices, np.concatenate([up, up[:, ::-1] + 9])


def test_vertices_in_one_place_part_into_their_fans_and_the_others_stay() -> None:
    vertices, faces = hourglass()
    parted = part_touching(vertices, faces)
    np.testing.assert_array_equal(parted[:8], vertices[:8])
    np.testing.assert_array_equal(parted[9:17], vertices[9:17])
    # the middle of the cone's faces is two thirds up
    np.testing.assert_allclose(parted[8], [0.0, 0.0, PARTING * 2 / 3], atol=1e-15)
    np.testing.assert_allclose(parted[17], [0.0, 0.0, -PARTING * 2 / 3], atol=1e-15)
    assert len(np.unique(parted, axis=0)) == 18
    np.testing.assert_array_equal(part_touching(vertices[:8], np.array([[0, 1, 2]])), vertices[:8])


def test_vertices_are_joined_by_place_without_a_branch_or_a_needle(tmp_path: Path) -> None:
    # three sheets at one edge, each with vertices of its own, and a needle
    wing = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 1], [0.5, 0, 1]])
    soup = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 4, 5]])
    vertices = wing[soup].reshape(-1, 3)
    vertices, faces = welded(vertices, np.arange(12).reshape(4, 3))
    # the shorter faces at the edge stay
    assert len(faces) == 2
    assert_sound(TriangleMesh(vertices=vertices, faces=faces), tmp_path)
    kept, same = welded(*grid(5))
    assert len(kept) == 25
    assert len(same) == 32
