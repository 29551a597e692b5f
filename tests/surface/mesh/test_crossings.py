"""Fillings that pass through other faces are found."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface import build
from semsfm_colmap.surface.mesh.close import close_holes
from semsfm_colmap.surface.mesh.crossings import END, crossing_faces
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.oracles.crossings import crossing_faces_by_pairs
from tests.surface.scene import RADIUS, ball_points


@pytest.mark.parametrize("seed", range(4))
def test_crossings_of_scattered_triangles_are_those_of_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = np.repeat(rng.uniform(-2.0, 2.0, (40, 3)), 3, axis=0) + rng.normal(size=(120, 3))
    faces = np.arange(120).reshape(40, 3)
    # some share vertices
    faces[:10, 0] = faces[10:20, 1]
    mesh = TriangleMesh(vertices=vertices, faces=faces, face_filled=rng.random(40) < 0.3)
    found = crossing_faces(mesh)
    np.testing.assert_array_equal(found, crossing_faces_by_pairs(mesh, END))
    assert 10 < len(found) < 40


def open_box_with_a_spike(height: float) -> TriangleMesh:
    """A box without its lid, z from 0 to 1, a spike of some height from its floor; then closed."""
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    inner = np.array([[0.4, 0.3, 0.0], [0.6, 0.3, 0.0], [0.5, 0.5, 0.0], [0.5, 0.35, height]])
    vertices = np.concatenate([corners, inner])
    floor = [
        [0, 8, 1], [1, 8, 9], [1, 9, 3], [3, 9, 10], [3, 10, 2], [2, 10, 0], [0, 10, 8],
    ]  # fmt: skip
    spike = [[8, 11, 9], [9, 11, 10], [10, 11, 8]]
    walls = [
        [0, 1, 5], [0, 5, 4], [1, 3, 7], [1, 7, 5], [3, 2, 6], [3, 6, 7], [2, 0, 4], [2, 4, 6],
    ]  # fmt: skip
    seen = np.array([*floor, *spike, *walls])
    vertices, faces, _ = close_holes(vertices, seen, None)
    return TriangleMesh(
        vertices=vertices, faces=faces, face_filled=np.arange(len(faces)) >= len(seen)
    )


def test_a_spike_through_a_lid_is_found_and_one_below_it_is_not() -> None:
    assert len(crossing_faces(open_box_with_a_spike(0.9))) == 0
    mesh = open_box_with_a_spike(1.2)
    found = crossing_faces(mesh)
    assert mesh.face_filled is not None
    # the three faces of the spike, and what of the lid they pass through
    assert {7, 8, 9} < set(found.tolist())
    assert mesh.face_filled[found].sum() == len(found) - 3
    record = build.mesh_record(mesh, "ball-pivoting")
    assert record.num_crossing_faces == len(found)
    assert f"{len(found)} faces pass through one another" in build.mesh_lines(record)[-1]


def test_a_closed_ball_does_not_cross_itself() -> None:
    points = ball_points(3000)
    points = points[points[:, 2] < 0.5 * RADIUS]
    cloud = PointCloud(points=points, normals=points / RADIUS)
    mesh = build.mesh(cloud, SurfaceOptions(watertight=True)).value
    assert mesh is not None
    assert mesh.face_filled is not None
    assert mesh.face_filled.sum() > 10
    record = build.mesh_record(mesh, "ball-pivoting")
    assert record.num_crossing_faces == 0
    assert len(build.mesh_lines(record)) == 2


def test_a_mesh_without_fillings_has_no_crossing_of_them() -> None:
    faces = np.array([[0, 1, 2]])
    assert len(crossing_faces(TriangleMesh(vertices=np.eye(3), faces=faces))) == 0
    none = TriangleMesh(vertices=np.eye(3), faces=faces, face_filled=np.zeros(1, dtype=bool))
    assert len(crossing_faces(none)) == 0
