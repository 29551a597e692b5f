"""The height field over the mean viewing direction."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.holes import boundary_loops
from semsfm_colmap.surface.mesh.methods.delaunay import nearest_of_cell, plane_basis
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.surface.mesh.methods.contract import MesherContract, sheet
from tests.surface.scene import RADIUS, ball_points


class TestDelaunay(MesherContract):
    method = "delaunay-2.5d"


def test_a_hole_of_the_field_stays_a_hole() -> None:
    cloud = sheet()
    keep = np.linalg.norm(cloud.points[:, :2], axis=1) > 0.5
    holed = PointCloud(points=cloud.points[keep], normals=np.asarray(cloud.normals)[keep])
    mesh = mesh_cloud(holed, SurfaceOptions(method="delaunay-2.5d", max_hole_edges=0))
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    assert np.linalg.norm(centre[:, :2], axis=1).min() > 0.45
    loops = boundary_loops(mesh.faces)
    assert sorted(len(loop) > 15 for loop in loops)[-2:] == [True, True]


def test_what_was_seen_from_all_sides_is_refused() -> None:
    points = ball_points(2000)
    cloud = PointCloud(points=points, normals=points / RADIUS)
    with pytest.raises(InputError, match="from all sides"):
        mesh_cloud(cloud, SurfaceOptions(method="delaunay-2.5d"))


def test_the_basis_of_the_plane_is_right_handed() -> None:
    for normal in np.random.default_rng(0).normal(size=(20, 3)):
        unit = normal / np.linalg.norm(normal)
        e1, e2 = plane_basis(unit).T
        np.testing.assert_allclose(np.cross(e1, e2), unit, atol=1e-12)


def test_of_points_on_one_line_of_sight_the_highest_counts() -> None:
    plane = np.array([[0.1, 0.1], [0.2, 0.2], [5.0, 5.0]])
    np.testing.assert_array_equal(nearest_of_cell(plane, np.array([1.0, 2.0, 0.0]), 1.0), [1, 2])
    assert len(nearest_of_cell(np.zeros((0, 2)), np.zeros(0), 1.0)) == 0
