"""Which images are compared, and how the pixels of one map into another."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.surface.stereo.views import (
    affine_sweep,
    baseline_angles,
    choose_neighbors,
    choose_references,
    depth_range,
)
from semsfm_colmap.types import OrthographicCameras
from tests.surface.scene import ball_points, reconstruction_of, turning_cameras


def arbitrary_cameras(num: int) -> OrthographicCameras:
    rng = np.random.default_rng(5)
    return OrthographicCameras(
        cam_from_world=rotation_from_vector(rng.normal(size=(num, 3))),
        scale_px_per_unit=rng.uniform(10, 30, num),
        translation_px=rng.uniform(0, 500, (num, 2)),
        aspect=1.04,
        skew=0.02,
    )


def test_the_sweep_maps_are_those_of_the_cameras() -> None:
    cameras = arbitrary_cameras(4)
    points = np.random.default_rng(6).normal(size=(20, 3))
    scaling = np.random.default_rng(7).uniform(0.2, 1.0, (4, 2))
    neighbors = np.array([3, 0, 2])
    sweep = affine_sweep(cameras, 1, neighbors, scaling)
    depth = points @ cameras.viewing_direction[1]
    ref = cameras.project(points, np.full(20, 1)) * scaling[1]
    for k, j in enumerate(neighbors):
        mapped = ref @ sweep.B[k].T + depth[:, None] * sweep.c[k] + sweep.e[k]
        expected = cameras.project(points, np.full(20, j)) * scaling[j]
        np.testing.assert_allclose(mapped, expected, atol=1e-9)


def test_parallax_is_the_sine_of_the_angle_between_the_viewing_directions() -> None:
    cameras = turning_cameras([0.0, 10.0, 30.0])
    sweep = affine_sweep(cameras, 0, np.array([1, 2]), np.ones((3, 2)))
    np.testing.assert_allclose(
        np.linalg.norm(sweep.c, axis=1), 20.0 * np.sin(np.radians([10.0, 30.0]))
    )
    np.testing.assert_allclose(np.degrees(baseline_angles(cameras, 0)), [0, 10, 30], atol=1e-9)


def neighbors_of(cameras: OrthographicCameras, reference: int, num: int = 4) -> list[int]:
    chosen = choose_neighbors(
        cameras,
        reference,
        num=num,
        min_angle_rad=np.radians(2.0),
        max_angle_rad=np.radians(15.0),
    )
    return [int(i) for i in chosen]


def test_neighbours_spread_evenly_on_both_sides() -> None:
    cameras = turning_cameras(list(np.arange(-20.0, 21.0, 1.0)))
    angles = np.arange(-20, 21)[neighbors_of(cameras, 20)]
    assert sorted(abs(angles))[-2:] == [15, 15]
    assert (angles < 0).sum() == (angles > 0).sum() == 2
    assert min(abs(angles)) >= 5


def test_a_turn_in_the_image_plane_is_no_neighbour() -> None:
    tilted = turning_cameras([0.0, 0.0, 5.0, -5.0])
    roll = rotation_from_vector(np.array([0.0, 0.0, 0.5]))
    R = np.array(tilted.cam_from_world)
    R[1] = roll @ R[1]
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=tilted.scale_px_per_unit,
        translation_px=tilted.translation_px,
    )
    assert sorted(neighbors_of(cameras, 0)) == [2, 3]


def test_with_no_image_in_range_the_two_nearest_are_taken() -> None:
    cameras = turning_cameras([0.0, 25.0, -20.0, 30.0, 80.0])
    assert neighbors_of(cameras, 0) == [2, 1]


def test_without_parallax_there_is_no_neighbour() -> None:
    assert neighbors_of(turning_cameras([0.0, 0.5, 1.0]), 0) == []


def test_references_are_all_images_or_spread_over_the_directions() -> None:
    cameras = turning_cameras(list(np.linspace(0, 90, 31)))
    np.testing.assert_array_equal(choose_references(cameras, 31), np.arange(31))
    chosen = choose_references(cameras, 7)
    assert len(np.unique(chosen)) == 7
    assert {0, 30} <= set(chosen.tolist())
    assert np.diff(chosen).max() <= 8


def test_a_fine_series_has_references_as_far_apart_as_asked_and_little_farther() -> None:
    angles = np.arange(0.0, 90.1, 1.25)
    chosen = choose_references(turning_cameras(angles.tolist()), 100, np.radians(4.0))
    gaps = np.diff(angles[chosen])
    assert chosen[0] == 0
    assert gaps.min() >= 4.0 - 1e-6
    assert gaps.max() < 4.0 + 1.25
    coarse = choose_references(turning_cameras([0.0, 5.0, 10.0, 15.0]), 100, np.radians(4.0))
    np.testing.assert_array_equal(coarse, [0, 1, 2, 3])


def test_more_references_than_directions_are_still_distinct() -> None:
    chosen = choose_references(turning_cameras([0.0] * 5 + [10.0] * 5), 8)
    assert len(np.unique(chosen)) == 8


def test_the_depth_range_is_that_of_the_points_seen_with_a_margin() -> None:
    points = ball_points(500)
    points[:, 2] = np.linspace(-10.0, 10.0, 500)
    visible = np.zeros((2, 500), dtype=bool)
    visible[0] = True
    visible[1, :2] = True
    reconstruction = reconstruction_of(turning_cameras([0.0, 5.0]), ("a", "b"), points, visible)
    low, high = depth_range(reconstruction, 0, 0.2) or (np.nan, np.nan)
    assert low == pytest.approx(-9.8 - 0.2 * 19.6)
    assert high == pytest.approx(9.8 + 0.2 * 19.6)
    # a flat specimen has 20 px, at 20 px per unit, to hide some relief in
    assert depth_range(reconstruction, 0, 0.0) == pytest.approx((-10.8, 10.8))
    assert depth_range(reconstruction, 1, 0.1) is None
