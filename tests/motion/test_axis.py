import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import MIRROR_Z, depth_reversed, rotation_from_vector
from semsfm_colmap.motion.axis import fit_axis
from tests.report.series import AXIS, turned


def test_known_steps_and_axis_are_recovered_exactly():
    angles = np.cumsum([0.0, 3.1, 4.7, 2.2, 5.9, 3.3])
    series = fit_axis(turned(angles))
    assert series is not None
    np.testing.assert_allclose(np.rad2deg(series.angle_rad), angles, atol=1e-10)
    np.testing.assert_allclose(series.axis_camera, AXIS, atol=1e-12)
    np.testing.assert_allclose(series.wobble_rad, 0.0, atol=1e-12)


def test_the_world_frame_does_not_matter():
    R, G = turned(np.arange(9) * 4.0), rotation_from_vector(np.array([1.0, -2.0, 0.5]))
    one, other = fit_axis(R), fit_axis(R @ G)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(other.angle_rad, one.angle_rad, atol=1e-12)
    np.testing.assert_allclose(other.axis_camera, one.axis_camera, atol=1e-12)
    np.testing.assert_allclose(G @ other.axis_world, one.axis_world, atol=1e-12)


def test_the_axis_is_signed_so_that_the_series_turns_forward():
    series = fit_axis(turned(-np.arange(7) * 5.0))
    assert series is not None
    np.testing.assert_allclose(series.axis_camera, -AXIS, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(series.step_rad), 5.0, atol=1e-10)


def test_the_depth_reversed_twin_turns_the_other_way():
    R = turned(np.arange(7) * 5.0)
    series = fit_axis(depth_reversed(R))
    assert series is not None
    np.testing.assert_allclose(series.axis_camera, -MIRROR_Z @ AXIS, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(series.step_rad), 5.0, atol=1e-10)


def test_more_than_one_turn_is_unwrapped():
    series = fit_axis(turned(np.arange(37) * 15.0))
    assert series is not None
    assert np.rad2deg(series.range_rad) == pytest.approx(540.0, abs=1e-9)


def test_one_misplaced_image_does_not_turn_the_axis():
    R = turned(np.arange(20) * 4.0)
    noise = np.random.default_rng(0).normal(scale=np.deg2rad(0.02), size=(20, 3))
    R = rotation_from_vector(noise) @ R
    R[11] = rotation_from_vector(np.array([0.3, 0.0, 0.2])) @ R[11]
    series = fit_axis(R)
    assert series is not None
    assert np.rad2deg(np.arccos(series.axis_camera @ AXIS)) < 0.1
    assert np.argmax(series.wobble_rad) == 11


def test_the_wobble_is_the_tilt_of_the_axis_in_each_image():
    tilt = np.deg2rad(0.5)
    away = np.array([0.0, 0.0, 1.0]) - AXIS[2] * AXIS
    sway = np.where(np.arange(24) % 2 == 0, tilt, -tilt)[:, None] * away / np.linalg.norm(away)
    R = rotation_from_vector(sway) @ turned(np.arange(24) * 15.0)
    series = fit_axis(R)
    assert series is not None
    np.testing.assert_allclose(np.rad2deg(series.wobble_rad), 0.5, atol=1e-3)


def test_a_full_turn_closes_with_the_step_that_is_missing():
    series = fit_axis(turned(np.arange(72) * 5.0))
    assert series is not None
    assert series.is_full_turn
    assert np.rad2deg(series.closing_step_rad) == pytest.approx(5.0, abs=1e-9)


def test_a_full_turn_that_repeats_the_first_image_closes_with_nothing():
    series = fit_axis(turned(np.arange(73) * 5.0))
    assert series is not None
    assert series.is_full_turn
    assert np.rad2deg(series.closing_step_rad) == pytest.approx(0.0, abs=1e-9)


def test_half_a_turn_is_not_a_full_one():
    series = fit_axis(turned(np.arange(37) * 5.0))
    assert series is not None
    assert not series.is_full_turn


def test_two_images_have_an_exact_axis():
    series = fit_axis(turned([0.0, 7.0]))
    assert series is not None
    np.testing.assert_allclose(series.axis_camera, AXIS, atol=1e-10)


@pytest.mark.parametrize("angles", [[], [0.0], [0.0, 0.0, 0.0]])
def test_nothing_that_turns_has_no_axis(angles):
    R = turned(angles) if angles else np.zeros((0, 3, 3))
    assert fit_axis(R) is None
