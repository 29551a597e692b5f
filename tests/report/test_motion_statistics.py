from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.motion_statistics import motion_statistics
from semsfm_colmap.types import SemMetadata, SemSeries
from tests.report.series import make_inputs, make_reconstruction


def motion_of(inputs):
    return motion_statistics(inputs, order_frames(inputs))


def test_steps_and_range_of_a_known_series_are_recovered():
    angles = np.cumsum([0.0, 3.0, 5.0, 4.0, 6.0])
    rotation, columns = motion_of(make_inputs(make_reconstruction(angles)))
    np.testing.assert_allclose(columns.angle_deg, angles, atol=1e-9)
    assert np.isnan(columns.step_deg[0])
    np.testing.assert_allclose(columns.step_deg[1:], np.diff(angles), atol=1e-9)
    np.testing.assert_allclose(columns.rotation_from_first_deg, angles, atol=1e-6)
    assert rotation.range_deg == pytest.approx(18.0)
    assert rotation.closure.is_full_turn is False


def test_where_nothing_turns_there_is_no_motion():
    rotation, columns = motion_of(make_inputs(make_reconstruction(np.zeros(3))))
    assert rotation is None
    assert np.isnan(columns.angle_deg).all()
    np.testing.assert_allclose(columns.rotation_from_first_deg, 0.0, atol=1e-6)


def test_a_full_turn_with_an_angle_scale_error_shows_it_in_the_closing_step():
    error = 0.004
    angles = np.arange(72) * 5.0 * (1.0 + error)
    rotation, _ = motion_of(make_inputs(make_reconstruction(angles)))
    closure = rotation.closure
    assert closure.is_full_turn is True
    assert closure.closing_minus_median_step_deg == pytest.approx(-360.0 * error, abs=1e-9)
    assert closure.last_to_first_rotation_deg == pytest.approx(closure.last_to_first_deg)


def test_the_slope_against_the_stage_tilt_is_the_angle_scale():
    angles = np.arange(10) * 3.0
    inputs = make_inputs(make_reconstruction(1.004 * angles))
    frames = tuple(
        replace(frame, metadata=SemMetadata(tilt_rad=None if k == 4 else np.deg2rad(10.0 - tilt)))
        for k, (frame, tilt) in enumerate(zip(inputs.series.frames, angles, strict=True))
    )
    rotation, columns = motion_of(replace(inputs, series=SemSeries(frames=frames)))
    tilt = rotation.stage_tilt
    assert tilt.slope == pytest.approx(1.004)
    assert tilt.rms_deg < 1e-9
    assert tilt.num_images == 9
    assert np.isnan(columns.stage_tilt_deg[4])
    assert columns.stage_tilt_deg[0] == pytest.approx(10.0)


def test_the_uncertainty_about_the_axis_combines_those_about_x_y_z():
    rec = make_reconstruction(np.arange(6) * 4.0)
    sigma = np.full((6, 3), np.deg2rad(0.02))
    _, columns = motion_of(make_inputs(replace(rec, sigma_rotation_rad=sigma)))
    assert columns.sigma_angle_deg[3] == pytest.approx(0.02)


def test_merged_series_have_no_motion_about_one_axis():
    inputs = make_inputs(make_reconstruction(np.arange(6) * 5.0))
    frames = inputs.series.frames
    parts = tuple(replace(f, series="ab"[k % 2]) for k, f in enumerate(frames))
    rotation, columns = motion_of(replace(inputs, series=replace(inputs.series, frames=parts)))
    assert rotation is None
    assert np.isnan(columns.angle_deg).all()
    np.testing.assert_allclose(columns.rotation_from_first_deg, np.arange(6) * 5.0, atol=1e-6)
