"""Meshes of clouds on a ball."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.halfedges import (
    component_labels,
    num_boundary_edges,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.oracles.surface import is_edge_manifold
from tests.surface.scene import RADIUS, ball_points

Method = Literal["ball-pivoting", "poisson"]
BOTH = pytest.mark.parametrize("method", ["ball-pivoting", "poisson"])


def noisy_ball(num: int = 4000, unit: float = 1.0, *, half: bool = False) -> PointCloud:
    points = ball_points(num)
    normals = points / RADIUS
    points = points + 0.01 * np.random.default_rng(3).normal(size=(num, 1)) * normals
    keep = normals[:, 2] < 0.2 if half else np.ones(num, dtype=bool)
    colors = np.repeat(np.clip(128 + 120 * normals[:, :1], 0, 255), 3, axis=1).astype(np.uint8)
    return PointCloud(points=unit * points[keep], normals=normals[keep], colors=colors[keep])


def options(method: Method) -> SurfaceOptions:
    return SurfaceOptions(method=method, poisson_depth=6)


def assert_sound(mesh: TriangleMesh) -> None:
    assert is_edge_manifold(mesh.faces)
    assert component_labels(mesh.faces).max() == 0
    assert mesh.vertex_normals is not None
    assert len(mesh.vertex_normals) == len(mesh.vertices) == mesh.faces.max() + 1


@BOTH
def test_a_ball_becomes_one_closed_oriented_surface(method: Method) -> None:
    mesh = mesh_cloud(noisy_ball(), options(method))
    assert_sound(mesh)
    assert num_boundary_edges(mesh.faces) < 0.01 * 1.5 * len(mesh.faces)
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert abs(np.median(radius) - RADIUS) < 0.01
    assert np.abs(radius - RADIUS).max() < 0.05
    outward = np.einsum(
        "fi,fi->f", face_normals(mesh.vertices, mesh.faces), mesh.vertices[mesh.faces].mean(axis=1)
    )
    # slivers of the Poisson surface stand across it
    assert outward[outward < 0].sum() > -1e-3 * outward.sum()


@BOTH
def test_what_was_not_seen_stays_open(method: Method) -> None:
    mesh = mesh_cloud(noisy_ball(half=True), options(method))
    assert_sound(mesh)
    # the points end at 0.2 radii; Poisson may go on for three spacings
    assert mesh.vertices[:, 2].max() < (0.25 if method == "ball-pivoting" else 0.55) * RADIUS
    assert num_boundary_edges(mesh.faces) > 20


@BOTH
def test_vertex_colours_are_those_of_the_points_there(method: Method) -> None:
    mesh = mesh_cloud(noisy_ball(), options(method))
    assert mesh.vertex_colors is not None
    expected = np.clip(128 + 120 * mesh.vertices[:, 0] / RADIUS, 0, 255)
    assert np.abs(mesh.vertex_colors[:, 0] - expected).mean() < 6.0


@pytest.mark.parametrize("method", ["ball-pivoting", "poisson", "tsdf"])
@pytest.mark.parametrize("exponent", [-40, -20, 10, 40])
def test_the_unit_of_the_world_does_not_matter(exponent: int, method: str) -> None:
    # 2^-40 is a picometre of a metre
    asked = SurfaceOptions(method=method, poisson_depth=6)
    usual = mesh_cloud(noisy_ball(2000), asked)
    other = mesh_cloud(noisy_ball(2000, unit=2.0**exponent), asked)
    np.testing.assert_array_equal(usual.faces, other.faces)
    np.testing.assert_array_equal(other.vertices, 2.0**exponent * usual.vertices)


def test_a_cloud_without_normals_is_misuse() -> None:
    with pytest.raises(UsageError, match="normals"):
        mesh_cloud(PointCloud(points=ball_points(100)), SurfaceOptions())


def test_a_handful_of_points_is_an_error_with_a_way_out() -> None:
    with pytest.raises(InputError, match="4 points, too few"):
        mesh_cloud(PointCloud(points=np.eye(4, 3), normals=np.eye(4, 3)), SurfaceOptions())


def test_points_that_no_ball_can_touch_are_an_error_with_a_way_out() -> None:
    line = np.arange(100.0)[:, None] * [1.0, 0.0, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (100, 1))
    with pytest.raises(InputError, match="No surface"):
        mesh_cloud(PointCloud(points=line, normals=normals), SurfaceOptions())


def capless_ball(min_z: float) -> PointCloud:
    points = ball_points(4000)
    points = points[points[:, 2] > min_z * RADIUS]
    return PointCloud(points=points, normals=points / RADIUS)


@pytest.mark.parametrize("which", ["none", "small", "all"])
def test_holes_are_closed_as_asked_and_what_closes_them_is_marked(
    which: Literal["none", "small", "all"],
) -> None:
    cloud = capless_ball(-0.6)
    mesh = mesh_cloud(cloud, SurfaceOptions(fill_holes=which))
    assert mesh.face_filled is not None
    assert is_edge_manifold(mesh.faces)
    rim = num_boundary_edges(mesh.faces)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    lid = middle[:, 2] < -0.55 * RADIUS
    inside = np.linalg.norm(middle, axis=1) < 0.9 * RADIUS
    if which == "all":
        assert rim == 0
        # the lid hangs in the air, far from every point, and is marked
        assert mesh.face_filled[inside].all()
        assert (inside & lid).any()
    else:
        assert rim > SurfaceOptions().max_hole_edges
        assert not inside.any()
    if which == "none":
        assert not mesh.face_filled.any()
