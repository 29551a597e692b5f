import numpy as np
import pytest

from semsfm_colmap.motion.axis import fit_axis
from semsfm_colmap.motion.path import specimen_path
from semsfm_colmap.types import OrthographicCameras
from tests.motion.turning import cameras as rotations

BESIDE_PX = 12.0


def series_of(angles_deg, shift=None, scale=4.0):
    """Cameras whose world origin lies `BESIDE_PX` beside the axis, and the rotation's figures."""
    R = rotations(angles_deg)
    turn = fit_axis(R)
    beside = np.cross(turn.axis_world, [0.3, 0.5, 0.8])
    beside *= BESIDE_PX / scale / np.linalg.norm(beside)
    translation = np.full((len(R), 2), 100.0) + (0.0 if shift is None else shift)
    cameras = OrthographicCameras(
        cam_from_world=R, scale_px_per_unit=np.full(len(R), scale), translation_px=translation
    )
    return cameras, turn, beside


def test_a_circle_is_found_exactly_with_its_depth():
    cameras, turn, beside = series_of(np.arange(0.0, 200.0, 5.0))
    path = specimen_path(cameras, beside, turn)
    assert path.circle.radius_px == pytest.approx(BESIDE_PX, rel=1e-9)
    np.testing.assert_allclose(path.circle.drift_px_per_rad, 0.0, atol=1e-8)
    depth = 4.0 * np.asarray(cameras.cam_from_world) @ beside
    np.testing.assert_allclose(path.circle.repeated_px[:, 2], depth[:, 2], atol=1e-8)
    np.testing.assert_allclose(path.circle.axis_shift_px(path.centre_px), 0.0, atol=1e-8)


def test_drift_with_the_turn_and_circle_are_told_apart():
    angles = np.arange(0.0, 300.0, 5.0)
    drift = np.radians(angles)[:, None] * np.array([3.0, -2.0])
    cameras, turn, beside = series_of(angles, drift)
    path = specimen_path(cameras, beside, turn)
    np.testing.assert_allclose(path.circle.drift_px_per_rad, [3.0, -2.0], atol=1e-8)
    assert path.circle.radius_px == pytest.approx(BESIDE_PX, rel=1e-9)


def test_moves_keep_the_specimen_where_the_first_image_shows_it():
    angles = np.arange(0.0, 300.0, 5.0)
    drift = np.radians(angles)[:, None] * np.array([3.0, -2.0])
    cameras, turn, beside = series_of(angles, drift)
    path = specimen_path(cameras, beside, turn)
    moved = path.centre_px + path.circle.moves_px[:, :2]
    np.testing.assert_allclose(moved, np.tile(moved[0], (len(moved), 1)), atol=1e-8)
    np.testing.assert_allclose(path.circle.moves_px[0], 0.0)


def test_a_jump_in_one_image_does_not_bend_the_circle():
    angles = np.arange(0.0, 200.0, 5.0)
    rng = np.random.default_rng(0)
    shift = 0.1 * rng.normal(size=(len(angles), 2))
    shift[11] += 50.0
    cameras, turn, beside = series_of(angles, shift)
    circle = specimen_path(cameras, beside, turn).circle
    assert abs(circle.radius_px - BESIDE_PX) < 0.2


def test_the_sigma_of_the_radius_holds_for_independent_and_for_walking_shifts():
    angles = np.arange(0.0, 355.0, 5.0)
    for memory in (0.0, 0.8):
        pulls = []
        for seed in range(60):
            rng = np.random.default_rng(seed)
            walk = rng.normal(size=(len(angles), 2))
            for k in range(1, len(walk)):
                walk[k] += memory * walk[k - 1]
            cameras, turn, beside = series_of(angles, walk)
            circle = specimen_path(cameras, beside, turn).circle
            pulls.append((circle.radius_px - BESIDE_PX) / circle.sigma_px)
        assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_a_small_rotation_tells_no_circle_from_a_drift():
    cameras, turn, beside = series_of(np.arange(0.0, 20.0, 2.0))
    path = specimen_path(cameras, beside, turn)
    assert path.circle is None
    np.testing.assert_allclose(path.shift_px.mean(axis=0), 0.0, atol=1e-9)
