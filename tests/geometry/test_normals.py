"""Normals from local planes, their side, and stray points."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.normals import (
    estimate_normals,
    mean_direction_from,
    mean_viewing_direction,
    nearest_neighbors,
    orient_normals,
    sampling_distance,
    statistical_inliers,
)
from semsfm_colmap.geometry.rotations import rotation_from_vector
from tests.surface.scene import RADIUS, ball_points, reconstruction_of, turning_cameras


def test_normals_of_a_plane_are_exact_and_face_the_viewer() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (200, 2)), np.zeros(200)])
    away = np.tile([0.2, 0.1, 0.9], (200, 1))
    np.testing.assert_allclose(
        estimate_normals(points, away), np.tile([0.0, 0.0, -1.0], (200, 1)), atol=1e-9
    )


def test_normals_of_a_ball_seen_from_outside_point_outward_everywhere() -> None:
    points = ball_points(5000)
    normals = estimate_normals(points, -points / RADIUS)
    cosine = np.einsum("ni,ni->n", normals, points / RADIUS)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 5.0


def test_normals_turn_with_the_cloud() -> None:
    points = ball_points(400)
    R = rotation_from_vector(np.array([0.4, -1.0, 0.3]))
    turned = estimate_normals(points @ R.T, -points @ R.T)
    np.testing.assert_allclose(turned, estimate_normals(points, -points) @ R.T, atol=1e-7)


def test_a_normal_at_a_grazing_angle_follows_its_neighbours() -> None:
    normals = np.array([[0.0, 0.0, -1.0]] * 5)
    # seen edge-on, its own sign says nothing: 0.1 of the viewing direction on the wrong side
    normals[0] = [0.0, np.sqrt(1 - 0.01), -0.1]
    direction = np.tile([0.0, 0.0, 1.0], (5, 1))
    normals[1:] = [0.0, -np.sqrt(0.5), -np.sqrt(0.5)]
    neighbors = np.array([[j for j in range(5) if j != i] for i in range(5)])
    np.testing.assert_allclose(
        orient_normals(normals, direction, neighbors)[0], [0.0, -np.sqrt(1 - 0.01), 0.1]
    )


def test_the_mean_viewing_direction_counts_only_inlier_observations() -> None:
    cameras = turning_cameras([0.0, 60.0, 90.0])
    reconstruction = reconstruction_of(cameras, ("a", "b", "c"), np.zeros((2, 3)))
    inlier = np.array([True, True, False, True, False, False])
    object.__setattr__(reconstruction, "inlier", inlier)
    first, second = mean_viewing_direction(reconstruction)
    expected = cameras.viewing_direction[:2].sum(axis=0)
    np.testing.assert_allclose(first, expected / np.linalg.norm(expected))
    np.testing.assert_allclose(second, cameras.viewing_direction[0])


def test_a_point_is_not_its_own_neighbour() -> None:
    points = np.arange(5.0)[:, None] * [1.0, 0.0, 0.0]
    distance, idx = nearest_neighbors(points, 2)
    assert not np.any(idx == np.arange(5)[:, None])
    np.testing.assert_allclose(distance[0], [1.0, 2.0])


def test_the_sampling_distance_of_a_line_of_points_is_known() -> None:
    points = np.arange(1000.0)[:, None] * [0.5, 0.0, 0.0]
    assert sampling_distance(points) == pytest.approx(4 * 0.5)


def test_stray_points_are_found_whatever_the_unit() -> None:
    rng = np.random.default_rng(3)
    cloud = ball_points(2000)
    stray = rng.uniform(-3, 3, (20, 3)) * RADIUS
    stray = stray[np.abs(np.linalg.norm(stray, axis=1) - RADIUS) > 0.5]
    points = np.concatenate([cloud, stray])
    for unit in (1.0, 1e-6, 1e6):
        keep = statistical_inliers(unit * points, 16, 3.0)
        assert not keep[2000:].any()
        assert keep[:2000].mean() > 0.98


def test_a_handful_of_points_has_no_stray_ones() -> None:
    assert statistical_inliers(np.eye(3), 16, 2.0).all()


def test_the_mean_direction_is_that_of_the_rays_from_the_cameras() -> None:
    centres = np.array([[0.0, 0, -5], [5, 0, 0]])
    points = np.array([[0.0, 0, 0], [0, 0, 1], [3, 3, 3]])
    direction = mean_direction_from(centres, points, np.array([0, 1, 0]), np.array([0, 0, 1]))
    np.testing.assert_allclose(direction[0], [-np.sqrt(0.5), 0, np.sqrt(0.5)])
    np.testing.assert_allclose(direction[1], [0, 0, 1])
    np.testing.assert_array_equal(direction[2], 0)
