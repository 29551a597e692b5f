"""Standard deviations along the normals, part by part, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.fusion.error_bars import (
    RELIEF_FACTOR,
    ROUGHNESS_SHARE,
    SPREAD_SHARE,
    WINDOW_SHARE,
    camera_variance,
    matching_variance,
    roughness,
    with_error_bars,
)
from semsfm_colmap.types import Float, PointCloud
from tests.surface.scene import RADIUS, SCALE, ball_points, reconstruction_of, turning_cameras

SPACING = 1.0
NO_MODEL = reconstruction_of(turning_cameras([0, 5]), ("a", "b"), np.zeros((0, 3)))


def lattice(num: int = 30) -> Float:
    x, y = np.meshgrid(np.arange(num, dtype=float), np.arange(num, dtype=float))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(num**2)])


def plane(noise: float = 0.0, sigma: float = 0.1) -> PointCloud:
    points = lattice()
    points[:, 2] += noise * np.random.default_rng(4).normal(size=len(points))
    return PointCloud(
        points=points,
        normals=np.tile([0.0, 0.0, -1.0], (len(points), 1)),
        sigma=np.full(len(points), sigma),
    )


def test_the_variance_of_the_matching_falls_with_the_maps_in_its_noise_only() -> None:
    spread, window, num = np.array([0.5, 0.5]), np.array([2.0, 2.0]), np.array([1.0, 4.0])
    variance = matching_variance(spread, window, num)
    assert variance[0] - variance[1] == pytest.approx(WINDOW_SHARE * 4.0 * 0.75)
    np.testing.assert_allclose(matching_variance(spread, None, num), SPREAD_SHARE * 0.25)


def test_planes_and_spheres_are_not_rough() -> None:
    assert roughness(plane(), SPACING).max() < 1e-12
    points = ball_points(4000)
    ball = PointCloud(points=points, normals=points / RADIUS)
    assert roughness(ball, 0.1).max() < 1e-12


def test_the_roughness_of_a_noisy_plane_is_its_noise() -> None:
    rough = roughness(plane(noise=0.3), SPACING)
    # the weights are those of some twelve independent points
    assert 0.9 * 0.3 < np.sqrt(np.mean(rough**2)) < 1.02 * 0.3


def test_the_parts_add_up_in_squares() -> None:
    cloud = plane(noise=0.3, sigma=0.2)
    rough = roughness(cloud, SPACING)
    found = with_error_bars(cloud, NO_MODEL, SPACING).sigma
    relief = RELIEF_FACTOR * np.median(rough)
    np.testing.assert_allclose(found, np.sqrt(0.04 + ROUGHNESS_SHARE * rough**2 + relief**2))


def test_the_cameras_part_is_the_points_covariance_along_the_normal_without_their_relief() -> None:
    points = ball_points(800)
    outward = points / RADIUS
    relief_px, camera = 1.5, 0.07
    own = (relief_px / SCALE) ** 2 * np.einsum("ni,nj->nij", outward, outward)
    shared = np.tile(np.diag([0.0, 0.0, camera**2]), (len(points), 1, 1))
    visible = turning_cameras(np.arange(0.0, 360.0, 20.0))
    seen = visible.viewing_direction @ points.T < 0.0
    model = reconstruction_of(
        visible, tuple(f"{i}" for i in range(len(visible))), points, seen,
        point_covariance=own + shared, relief_px=np.float64(relief_px),
    )  # fmt: skip
    poles = np.array([[0.0, 0.0, RADIUS], [0.0, RADIUS, 0.0]])
    cloud = PointCloud(points=poles, normals=poles / RADIUS)
    along, across = np.sqrt(camera_variance(cloud, model))
    assert along == pytest.approx(camera, rel=0.25)
    assert across < 0.4 * camera


def test_without_covariances_the_cameras_add_nothing() -> None:
    assert not camera_variance(plane(), NO_MODEL).any()
    bare = PointCloud(points=lattice(), normals=None)
    assert with_error_bars(bare, NO_MODEL, SPACING) is bare
