"""Depth maps in space, under parallel and perspective projection."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.depth_view import LazyViews, parallel_view, pinhole_view, seen_by
from semsfm_colmap.surface.foreign_cloud import cloud_of_views
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import DepthMap
from tests.colmap.perspective_models import ball_depth as pinhole_ball_depth
from tests.colmap.perspective_models import look_at
from tests.surface.scene import HEIGHT, RADIUS, SCALE, WIDTH, ball_depth_maps, turning_cameras

SIZE = np.array([WIDTH, HEIGHT])
K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])


def parallel(i: int = 1, *, aspect: float = 1.0, skew: float = 0.0):
    cameras = turning_cameras([0.0, 40.0], aspect=aspect, skew=skew)
    return cameras, parallel_view(cameras, i, SIZE, ball_depth_maps(cameras, ("a", "b"))[i])


@pytest.mark.parametrize(("aspect", "skew"), [(1.0, 0.0), (1.1, 0.02)])
def test_points_of_a_parallel_map_lie_on_the_ball_and_project_to_their_pixels(
    aspect: float, skew: float
) -> None:
    cameras, view = parallel(aspect=aspect, skew=skew)
    row, col = view.pixels()
    points = view.points(row, col)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), RADIUS, rtol=1e-5)
    u, v, z = view.project(points)
    np.testing.assert_allclose(np.column_stack([u, v]), np.column_stack([col, row]) + 0.5)
    np.testing.assert_allclose(z, view.depth[row, col], atol=1e-6)
    image = np.full(len(points), 1)
    np.testing.assert_allclose(np.column_stack([u, v]), cameras.project(points, image), atol=1e-9)


def test_a_reduced_parallel_map_is_the_same_surface() -> None:
    cameras, whole = parallel()
    half = DepthMap(image_name="b", depth=whole.depth[::2, ::2])
    view = parallel_view(cameras, 1, SIZE, half)
    row, col = view.pixels()
    u, v, _ = view.project(whole.points(2 * row, 2 * col))
    # the first pixel of four lies a quarter of a large pixel off its centre
    np.testing.assert_allclose(np.column_stack([u, v]), np.column_stack([col, row]) + 0.25)


@pytest.mark.parametrize("max_size", [1024, 160, 100])
def test_points_of_a_pinhole_map_lie_on_the_ball(max_size: int) -> None:
    pose = look_at(np.array([2.0, 1.0, -5.0]))
    depth = pinhole_ball_depth(pose, K, (240, 320))
    view = pinhole_view(depth, K, pose, np.array([320, 240]), max_size_px=max_size)
    assert max(view.depth.shape) <= max_size
    row, col = view.pixels()
    assert len(row) > 100
    points = view.points(row, col)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.5, rtol=1e-5)


def test_a_map_smaller_than_its_image_has_its_own_pixels() -> None:
    pose = look_at(np.array([2.0, 1.0, -5.0]))
    small_K = np.diag([0.5, 0.5, 1.0]) @ K
    depth = pinhole_ball_depth(pose, small_K, (120, 160))
    view = pinhole_view(depth, K, pose, np.array([320, 240]))
    points = view.points(*view.pixels())
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.5, rtol=1e-5)


def test_rays_run_from_the_viewer_to_the_points() -> None:
    pose = look_at(np.array([2.0, 1.0, -5.0]))
    depth = pinhole_ball_depth(pose, K, (240, 320))
    view = pinhole_view(depth, K, pose, np.array([320, 240]))
    points = view.points(*view.pixels())
    expected = points - np.array([2.0, 1.0, -5.0])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    # K's own pixels lie half a px beside COLMAP's
    np.testing.assert_allclose(view.rays(points), expected, atol=1e-9)
    cameras, flat = parallel()
    there = flat.points(*flat.pixels())
    np.testing.assert_allclose(
        flat.rays(there), np.tile(cameras.viewing_direction[1], (len(there), 1)), atol=1e-12
    )


def test_the_size_of_a_pixel_is_the_distance_of_neighbours_across_the_ray() -> None:
    _, flat = parallel()
    there = flat.points(*flat.pixels())
    np.testing.assert_allclose(flat.pixel_size(there), 1.0 / SCALE)
    pose = look_at(np.array([0.0, 0.0, -5.0]))
    depth = pinhole_ball_depth(pose, K, (240, 320))
    view = pinhole_view(depth, K, pose, np.array([320, 240]))
    near = np.array([[0.0, 0.0, -1.5]])
    np.testing.assert_allclose(view.pixel_size(near), 3.5 / 300.0, rtol=1e-3)


def test_what_a_view_sees_at_a_place_decides_whether_it_agrees() -> None:
    _, view = parallel()
    points = view.points(*view.pixels())
    tolerance = np.full(len(points), 0.01)
    assert seen_by(view, points, tolerance).all()
    moved = points + 0.02 * view.depth_row[:3]
    assert not seen_by(view, moved, tolerance).any()
    assert not seen_by(view, points + 1e3, tolerance).any()


def test_lazy_views_are_made_when_asked_for() -> None:
    made: list[int] = []
    _, view = parallel()

    def make(i: int):
        made.append(i)
        return view

    views = LazyViews(make, 3)
    assert len(views) == 3
    assert made == []
    assert len(views[:2]) == 2
    assert len(list(views)) == 3
    assert made == [0, 1, 0, 1, 2]
    with pytest.raises(IndexError):
        views[3]


def test_tsdf_of_depth_maps_averages_their_noise_away() -> None:
    angles = list(np.arange(0.0, 360.0, 15.0))
    cameras = turning_cameras(angles)
    rng = np.random.default_rng(0)
    views = []
    for i, depth_map in enumerate(ball_depth_maps(cameras, tuple(map(str, angles)))):
        noisy = (depth_map.depth + 0.03 * rng.normal(size=depth_map.depth.shape)).astype(np.float32)
        noisy_map = DepthMap(image_name=depth_map.image_name, depth=noisy)
        views.append(parallel_view(cameras, i, SIZE, noisy_map))
    options = SurfaceOptions(method="tsdf", consistency_px=4.0, num_smoothing_iterations=0)
    cloud = cloud_of_views(views, options)
    mesh = mesh_cloud(cloud, options, views)
    away = np.linalg.norm(mesh.vertices, axis=1) - RADIUS
    # 0.03 in a map; some ten maps see each place
    assert 0.002 < np.std(away) < 0.015
    assert abs(np.median(away)) < 0.01
