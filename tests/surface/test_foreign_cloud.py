"""Clouds of other programs get normals from who saw them."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.depth_view import parallel_view
from semsfm_colmap.surface.foreign_cloud import (
    cloud_of_views,
    nearest_views,
    orient_cloud,
    viewed_cloud,
    with_spread,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import DepthMap, PointCloud
from tests.surface.scene import (
    HEIGHT,
    RADIUS,
    SCALE,
    WIDTH,
    ball_depth_maps,
    ball_points,
    turning_cameras,
)

OPTIONS = SurfaceOptions()
SIZE = np.array([WIDTH, HEIGHT])


def views(angles, change=lambda i, depth: depth):
    cameras = turning_cameras(angles)
    maps = ball_depth_maps(cameras, tuple(str(a) for a in angles))
    return [
        parallel_view(
            cameras, i, SIZE, DepthMap(image_name=m.image_name, depth=change(i, np.array(m.depth)))
        )
        for i, m in enumerate(maps)
    ]


def test_normals_point_toward_those_who_saw_the_points() -> None:
    points = ball_points(1500)
    cloud = viewed_cloud(points, -points / RADIUS, None, OPTIONS)
    assert cloud.normals is not None
    cosine = np.einsum("ni,ni->n", cloud.normals, cloud.points) / RADIUS
    assert cosine.min() > 0.9


def test_a_dense_cloud_is_turned_to_who_sees_the_sparse_points_near_it() -> None:
    sparse = ball_points(300, seed=2)
    given = PointCloud(points=ball_points(3000))
    cloud = orient_cloud(given, sparse, -sparse / RADIUS, OPTIONS)
    assert cloud.normals is not None
    assert np.einsum("ni,ni->n", cloud.normals, cloud.points).min() > 0


def test_its_own_normals_stay_and_get_unit_length() -> None:
    points = ball_points(100)
    normals = 3.0 * points
    normals[:4] = [[0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0], [0, 0, 0]]
    sigma = np.arange(100.0)
    given = PointCloud(points=points, normals=normals, sigma=sigma)
    cloud = orient_cloud(given, points[:0], points[:0], OPTIONS)
    np.testing.assert_array_equal(cloud.points, points[4:])
    np.testing.assert_allclose(cloud.normals, points[4:] / RADIUS)
    np.testing.assert_array_equal(cloud.sigma, sigma[4:])


def test_a_cloud_that_nobody_is_known_to_have_seen_is_one_sentence() -> None:
    nobody = np.zeros((0, 3))
    with pytest.raises(InputError, match="no normals"):
        orient_cloud(PointCloud(points=ball_points(100)), nobody, nobody, OPTIONS)


def test_depths_that_no_other_map_has_are_left_out() -> None:
    def spoilt(i, depth):
        if i == 3:
            depth[40:60, 60:80] -= 0.5  # 10 px in front of the ball
        return depth

    cloud = cloud_of_views(views(np.arange(0.0, 100.0, 12.0), spoilt), OPTIONS)
    assert np.abs(np.linalg.norm(cloud.points, axis=1) - RADIUS).max() < 0.1
    assert cloud.normals is not None
    assert np.einsum("ni,ni->n", cloud.normals, cloud.points).min() > 0


def test_two_maps_are_compared_with_one_another() -> None:
    cloud = cloud_of_views(views([0.0, 12.0]), OPTIONS)
    assert len(cloud.points) > 500


def test_maps_without_a_depth_are_one_sentence() -> None:
    empty = views([0.0, 10.0, 20.0], lambda _, depth: np.full_like(depth, np.nan))
    with pytest.raises(InputError, match="The 3 depth maps agree on 0 points"):
        cloud_of_views(empty, OPTIONS)


def test_the_nearest_views_turn_the_least() -> None:
    angles = [0.0, 50.0, 10.0, 30.0]
    np.testing.assert_array_equal(nearest_views(views(angles), 0, 2), [2, 3])
    np.testing.assert_array_equal(nearest_views(views(angles), 1, 9), [3, 2, 0])


def test_error_bars_of_depth_maps_are_the_deviation_between_them() -> None:
    rng = np.random.default_rng(4)
    noise = 0.3 / SCALE  # 0.3 px

    def noisy(_, depth):
        return depth + rng.normal(0.0, noise, depth.shape)

    cloud = cloud_of_views(views(np.arange(0.0, 100.0, 6.0), noisy), OPTIONS)
    assert cloud.sigma is not None
    assert cloud.normals is not None
    # noise along the rays, seen along the normals, by maps turned by up to 75 degrees
    assert 0.5 * noise < np.median(cloud.sigma) < noise
    exact = cloud_of_views(views(np.arange(0.0, 100.0, 6.0)), OPTIONS)
    assert exact.sigma is not None
    # what is left is that the ball is round within a pixel
    assert np.median(exact.sigma) < 0.15 * noise


def test_a_point_that_one_map_shows_is_uncertain_by_half_the_tolerance() -> None:
    one = views([0.0, 80.0])[:1]
    points = ball_points(4000)
    points = points[points[:, 2] < -0.7 * RADIUS]
    cloud = with_spread(PointCloud(points=points, normals=points / RADIUS), one, OPTIONS)
    np.testing.assert_allclose(cloud.sigma, 0.5 * OPTIONS.consistency_px / SCALE)


def test_without_maps_there_are_no_error_bars() -> None:
    points = ball_points(50)
    cloud = PointCloud(points=points, normals=points / RADIUS)
    assert with_spread(cloud, [], OPTIONS) is cloud


def test_error_bars_of_sparse_points_are_those_along_the_normals() -> None:
    points = ball_points(1500)
    n = points / RADIUS
    # 0.2 along the normal, 0.01 across it
    C = 1e-4 * np.eye(3) + (0.04 - 1e-4) * n[:, :, None] * n[:, None]
    cloud = viewed_cloud(points, -n, None, OPTIONS, C)
    np.testing.assert_allclose(cloud.sigma, 0.2, rtol=0.1)
