"""The sparse cloud, thinning, smoothing, and the removal of second layers."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.fusion.cloud import (
    dominant_layer,
    smooth_along_normals,
    sparse_cloud,
    thin,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.surface.scene import RADIUS, ball_points, reconstruction_of, turning_cameras


def together(first: PointCloud, second: PointCloud) -> PointCloud:
    return PointCloud(
        points=np.concatenate([first.points, second.points]),
        normals=np.concatenate([first.normals, second.normals]),
    )


def ball_cloud(num: int, noise: float = 0.0) -> PointCloud:
    points = ball_points(num)
    normals = points / RADIUS
    jitter = noise * np.random.default_rng(8).normal(size=(num, 1))
    return PointCloud(points=points + jitter * normals, normals=normals)


def flat_cloud(height: float, side: float, num: int = 400) -> PointCloud:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(0, 20, (num, 2)), np.full(num, height)])
    return PointCloud(points=points, normals=np.tile([0.0, 0.0, side], (num, 1)))


def test_points_seen_in_too_few_images_are_left_out() -> None:
    points = ball_points(300)
    points[:, 2] = -np.abs(points[:, 2])
    visible = np.ones((4, 300), dtype=bool)
    visible[2:, 100:] = False
    reconstruction = reconstruction_of(
        turning_cameras([0, 5, 10, 15]), tuple("abcd"), points, visible
    )
    cloud = sparse_cloud(reconstruction, SurfaceOptions(max_outlier_sigma=50.0))
    np.testing.assert_array_equal(cloud.points, points[:100])
    assert cloud.normals is not None
    assert (cloud.normals[:, 2] < 0.2).all()


def test_the_deviation_of_a_sparse_point_is_that_along_its_normal() -> None:
    points = ball_points(60)
    covariance = np.tile(np.diag([1.0, 4.0, 7.0]), (60, 1, 1))
    reconstruction = reconstruction_of(
        turning_cameras([0, 5, 10]), tuple("abc"), points, point_covariance=covariance
    )
    cloud = sparse_cloud(reconstruction, SurfaceOptions(max_outlier_sigma=50.0))
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.sigma, np.sqrt(cloud.normals**2 @ [1.0, 4.0, 7.0]))


def test_too_few_points_are_an_error_that_names_the_option() -> None:
    reconstruction = reconstruction_of(turning_cameras([0, 5, 10]), tuple("abc"), ball_points(5))
    with pytest.raises(InputError, match=r"Only 5 points .* surface\.min_track_length"):
        sparse_cloud(reconstruction, SurfaceOptions())


def test_thinning_keeps_the_mean_of_each_cell() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(0, 4, (500, 3))
    colors = rng.integers(0, 255, (500, 3)).astype(np.uint8)
    sigma = rng.uniform(0.1, 1.0, 500)
    thinned = thin(PointCloud(points=points, colors=colors, sigma=sigma), 1.0)
    cells: dict[tuple[int, ...], list[int]] = {}
    for i, cell in enumerate(np.floor(points - points.min(axis=0)).astype(int)):
        cells.setdefault(tuple(cell.tolist()), []).append(i)
    assert len(thinned.points) == len(cells)
    expected = np.array([points[rows].mean(axis=0) for rows in cells.values()])
    order, other = np.lexsort(expected.T), np.lexsort(thinned.points.T)
    np.testing.assert_allclose(thinned.points[other], expected[order])
    deviation = np.array([np.sqrt((sigma[rows] ** 2).mean()) for rows in cells.values()])
    assert thinned.sigma is not None
    np.testing.assert_allclose(thinned.sigma[other], deviation[order])


def test_thinning_with_no_size_and_of_nothing_changes_nothing() -> None:
    cloud = ball_cloud(10)
    assert thin(cloud, 0.0) is cloud
    empty = PointCloud(points=np.zeros((0, 3)))
    assert thin(empty, 1.0) is empty


def test_smoothing_takes_out_noise_and_does_not_shrink_a_ball() -> None:
    noise = 0.02
    cloud = ball_cloud(8000, noise)
    smooth = smooth_along_normals(cloud, 24, 3)
    radius = np.linalg.norm(smooth.points, axis=1)
    assert radius.std() < 0.5 * noise
    assert abs(radius.mean() - RADIUS) < 0.1 * noise


def test_smoothing_leaves_the_two_sides_of_a_thin_sheet_apart() -> None:
    sheet = together(flat_cloud(0.0, -1.0), flat_cloud(0.2, 1.0))
    smooth = smooth_along_normals(sheet, 16, 3)
    np.testing.assert_allclose(smooth.points[:, 2], sheet.points[:, 2], atol=1e-12)


def test_of_two_layers_that_face_the_same_way_the_lighter_one_goes() -> None:
    both = together(flat_cloud(0.0, -1.0), flat_cloud(2.0, -1.0))
    keep = dominant_layer(both, np.repeat([10.0, 1.0], 400), 1.0)
    assert keep[:400].all()
    assert keep[400:].mean() < 0.05


def test_two_layers_that_face_opposite_ways_both_stay() -> None:
    both = together(flat_cloud(0.0, -1.0), flat_cloud(2.0, 1.0))
    assert dominant_layer(both, np.repeat([10.0, 1.0], 400), 1.0).all()


def test_selected_points_keep_the_attributes_the_cloud_has() -> None:
    cloud = PointCloud(points=np.zeros((3, 3)), sigma=np.array([1.0, 2.0, 3.0]))
    some = cloud.select(np.array([True, False, True]))
    assert len(some.points) == 2
    assert some.normals is None
    np.testing.assert_array_equal(some.sigma, [1.0, 3.0])
