"""Which cloud is meshed, and what comes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from semsfm_colmap.surface import build
from semsfm_colmap.surface.build import coverage, fuse_depth_maps, mesh
from semsfm_colmap.surface.fusion.fuse import fuse
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import DepthMap, PointCloud, Reconstruction
from tests.oracles.surface import is_edge_manifold
from tests.surface.scene import (
    RADIUS,
    SCALE,
    ball_points,
)

OPTIONS = SurfaceOptions()


def test_true_depth_maps_fuse_to_the_ball(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    cloud = fuse(maps, reconstruction, folder, OPTIONS)
    radius = np.linalg.norm(cloud.points, axis=1)
    assert SCALE * np.abs(radius - RADIUS).mean() < 0.1
    assert cloud.normals is not None
    outward = np.einsum("ni,ni->n", cloud.normals, cloud.points) / radius
    assert np.degrees(np.arccos(np.clip(outward, -1, 1))).mean() < 4.0
    assert cloud.sigma is not None
    assert np.median(SCALE * cloud.sigma) < 0.1
    # all around, up to where every image looks along the surface
    assert coverage(cloud, PointCloud(points=ball_points(2000))) > 0.93
    assert cloud.colors is not None
    assert 100 < cloud.colors.mean() < 160


def test_where_the_maps_agree_on_nothing_the_sparse_points_are_the_surface(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    empty = [replace(m, depth=np.full_like(m.depth, np.nan)) for m in maps[:3]]
    solution = fuse_depth_maps(empty, reconstruction, folder, OPTIONS)
    assert solution.status == "sparse"
    assert "made from the reconstructed points" in solution.message
    assert solution.value is not None
    assert len(solution.value.points) > 4000


def test_where_the_maps_leave_gaps_that_is_said(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    solution = fuse_depth_maps(maps[:9], reconstruction, folder, OPTIONS)
    assert solution.status == "gaps"
    assert 0.4 < solution.diagnostics["coverage"] < 0.8


def test_the_fused_cloud_becomes_one_sound_mesh(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    solution = fuse_depth_maps(maps, reconstruction, folder, OPTIONS)
    assert solution.status == "ok"
    assert solution.value is not None
    meshed = mesh(solution.value, OPTIONS)
    assert meshed.value is not None
    assert is_edge_manifold(meshed.value.faces)
    assert meshed.diagnostics["num_components"] == 1
    assert np.abs(SCALE * (np.linalg.norm(meshed.value.vertices, axis=1) - RADIUS)).max() < 1.0


def test_a_cloud_without_a_surface_is_a_failed_solution() -> None:
    failed = mesh(PointCloud(points=np.eye(4, 3), normals=np.eye(4, 3)), OPTIONS)
    assert failed.value is None
    assert not failed.ok
    assert "too few for a mesh" in failed.message


def test_a_mesh_is_noted_with_its_size_and_that_of_its_hull() -> None:
    points = ball_points(4000)
    cloud = PointCloud(points=points, normals=points / RADIUS)
    closed = build.mesh(cloud, SurfaceOptions(watertight=True)).value
    assert closed is not None
    record = build.mesh_record(closed, "ball-pivoting")
    volume, area = 4 / 3 * np.pi * RADIUS**3, 4 * np.pi * RADIUS**2
    assert record.num_boundary_edges == 0
    assert record.num_components == 1
    for value, true in (
        (record.volume, volume),
        (record.hull_volume, volume),
        (record.area, area),
        (record.hull_area, area),
    ):
        assert value is not None
        assert 0.97 * true < value < true
    first, second = build.mesh_lines(record, "um")
    assert "1 piece, closed (ball-pivoting)" in first
    assert f"volume {record.volume:.4g} um^3, convex hull" in second


def test_an_open_mesh_has_no_volume() -> None:
    points = ball_points(3000)
    points = points[points[:, 2] > 0]
    surface = build.mesh(PointCloud(points=points, normals=points / RADIUS), SurfaceOptions()).value
    assert surface is not None
    record = build.mesh_record(surface, "ball-pivoting")
    assert record.volume is None
    assert record.num_boundary_edges is not None
    assert record.num_boundary_edges > 10
    said = " ".join(build.mesh_lines(record))
    assert f"{record.num_boundary_edges} open edges" in said
    assert "^" not in said


def test_a_mesh_has_the_error_bars_of_its_cloud_if_it_has_any() -> None:
    points = ball_points(3000)
    cloud = PointCloud(points=points, normals=points / RADIUS)
    plain = build.mesh(cloud, SurfaceOptions()).value
    assert plain is not None
    assert plain.vertex_sigma is None
    # the left half is three times as uncertain as the right one
    sigma = np.where(points[:, 0] < 0, 0.3, 0.1)
    barred = build.mesh(replace(cloud, sigma=sigma), SurfaceOptions()).value
    assert barred is not None
    assert barred.vertex_sigma is not None
    x = barred.vertices[:, 0] / RADIUS
    np.testing.assert_allclose(barred.vertex_sigma[x < -0.2], 0.3)
    np.testing.assert_allclose(barred.vertex_sigma[x > 0.2], 0.1)
