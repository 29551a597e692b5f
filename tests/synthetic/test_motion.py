"""The turn of a series: angles, wobble, drift, and the options that ask for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.synthetic import SynthesizeOptions, example_options
from semsfm_colmap.synthetic.motion import (
    SCENE_DEFAULTS,
    Motion,
    image_rows,
    make_motion,
    nominal_angles_deg,
    nominal_scale,
    random_streams,
    view_of,
)

STILL = SynthesizeOptions(
    step_error_deg=0.0, wobble_deg=0.0, stage_drift_px=0.0, magnification_drift=0.0
)


def motion_of(options: SynthesizeOptions, seed: int = 0) -> Motion:
    return make_motion(options, np.random.default_rng(seed))


@pytest.mark.parametrize("scene", ["grain", "field", "clump"])
def test_each_scene_brings_its_own_series(scene: str) -> None:
    options = SynthesizeOptions(scene=scene)  # type: ignore[arg-type]
    angles = nominal_angles_deg(options)
    assert len(angles) == SCENE_DEFAULTS[scene].num_images
    assert angles[-1] - angles[0] == pytest.approx(SCENE_DEFAULTS[scene].range_deg)
    assert (angles[0] == 0.0) == (scene != "field")


def test_the_clump_closes_its_turn_with_the_step_after_the_last() -> None:
    angles = nominal_angles_deg(SynthesizeOptions(scene="clump"))
    step = angles[1] - angles[0]
    assert angles[-1] + step == pytest.approx(360.0)


def test_a_step_may_be_given_instead_of_a_range() -> None:
    angles = nominal_angles_deg(SynthesizeOptions(num_images=5, step_deg=2.5, start_deg=1.0))
    np.testing.assert_allclose(angles, [1.0, 3.5, 6.0, 8.5, 11.0])


def test_a_step_and_a_range_together_are_refused() -> None:
    with pytest.raises(UsageError, match="range_deg and step_deg"):
        nominal_angles_deg(SynthesizeOptions(step_deg=1.0, range_deg=10.0))


def test_no_images_are_refused() -> None:
    with pytest.raises(UsageError, match="1 or more"):
        nominal_angles_deg(SynthesizeOptions(num_images=0))


def test_a_databar_higher_than_the_image_is_refused() -> None:
    with pytest.raises(UsageError, match="16 x 16"):
        image_rows(SynthesizeOptions(height_px=64, databar_rows=60))


def test_one_image_stands_at_the_start() -> None:
    motion = motion_of(replace(STILL, num_images=1, start_deg=12.0))
    assert motion.true_deg.tolist() == [12.0]
    assert len(motion.cameras) == 1


def test_without_wobble_the_rotations_are_the_turn_about_the_axis() -> None:
    motion = motion_of(STILL)
    expected = rotation_from_vector(np.radians(motion.nominal_deg)[:, None] * motion.axis)
    np.testing.assert_allclose(motion.cameras.cam_from_world, expected, atol=1e-12)
    np.testing.assert_array_equal(np.ptp(motion.cameras.scale_px_per_unit), 0.0)
    np.testing.assert_array_equal(np.ptp(motion.cameras.translation_px, axis=0), 0.0)


def test_the_wobble_has_the_standard_deviation_that_was_asked_for() -> None:
    motion = motion_of(replace(STILL, num_images=400, wobble_deg=0.2))
    turn = rotation_from_vector(np.radians(motion.true_deg)[:, None] * motion.axis)
    rest = motion.cameras.cam_from_world @ np.swapaxes(turn, 1, 2)
    rms = np.degrees(np.sqrt(np.mean(rotation_angle(rest) ** 2) / 3.0))
    assert 0.18 < rms < 0.22


def test_the_stage_drifts_as_asked_and_never_far_away() -> None:
    motion = motion_of(replace(STILL, num_images=400, stage_drift_px=5.0))
    offset = motion.cameras.translation_px - motion.cameras.translation_px.mean(axis=0)
    # An autoregressive walk with memory a has the variance sigma^2 / (1 - a^2).
    expected = 5.0 / np.sqrt(1.0 - 0.85**2)
    assert 0.8 * expected < offset.std() < 1.2 * expected


def test_the_magnification_drifts_from_first_to_last() -> None:
    scale = motion_of(replace(STILL, magnification_drift=0.01)).cameras.scale_px_per_unit
    assert scale[-1] / scale[0] == pytest.approx(1.01, rel=1e-3)
    assert scale.mean() == pytest.approx(nominal_scale(STILL))


def test_the_pixel_size_can_be_chosen() -> None:
    motion = motion_of(replace(STILL, pixel_size_um=0.25))
    np.testing.assert_allclose(motion.unit_um / motion.cameras.scale_px_per_unit, 0.25)


def test_the_displacement_follows_the_rotation_of_the_ribbon() -> None:
    motion = motion_of(SynthesizeOptions(scene="clump"))
    assert motion.displacement_um is not None
    slope = np.polyfit(motion.displacement_um, motion.true_deg, 1)[0]
    assert slope == pytest.approx(171.3, rel=2e-3)
    assert np.std(motion.displacement_um - motion.true_deg / 171.3) == pytest.approx(1e-3, rel=0.3)


def test_only_the_clump_has_an_actuator() -> None:
    assert motion_of(SynthesizeOptions(scene="grain")).displacement_um is None


def test_scan_lines_are_shifted_by_drift_and_jitter() -> None:
    motion = motion_of(replace(STILL, num_images=2))
    shift = motion.row_shift_px(1)
    rows = image_rows(STILL)
    assert shift.shape == (rows, 2)
    drift = shift[-1, 1] - shift[0, 1]
    assert drift == pytest.approx(motion.frame_drift_px[1, 1] * (rows - 1) / rows)
    ramp = (np.arange(rows) + 0.5) / rows - 0.5
    np.testing.assert_allclose(
        shift[:, 0] - ramp * motion.frame_drift_px[1, 0], motion.row_jitter_px[1], atol=1e-12
    )


def test_the_view_covers_what_the_drift_brings_in() -> None:
    options = replace(STILL, scene="field", stage_drift_px=30.0)
    motion = motion_of(options)
    view = view_of(options, motion)
    corners = np.array([[0.0, 0.0], [options.width_px, image_rows(options)]])
    for t, s in zip(motion.cameras.translation_px, motion.cameras.scale_px_per_unit, strict=True):
        assert np.all(np.abs(corners - t) / s <= [view.half_width, view.half_height])
    assert np.degrees(view.max_tilt_rad) == pytest.approx(30.0, abs=0.2)


def test_the_example_is_small() -> None:
    options = example_options()
    assert len(nominal_angles_deg(options)) == 24
    assert (options.width_px, image_rows(options)) == (640, 480)
    assert np.ptp(nominal_angles_deg(options)) == pytest.approx(115.0)


def test_a_specimen_mounted_a_quarter_turn_on_turns_about_the_perpendicular_axis() -> None:
    first = motion_of(STILL)
    second = motion_of(replace(STILL, mount_deg=90.0))
    R, S = first.cameras.cam_from_world, second.cameras.cam_from_world
    # the direction in the specimen that every rotation of the series leaves as it is
    axes = [np.linalg.svd((Q[1:] - Q[:1]).reshape(-1, 3))[2][2] for Q in (R, S)]
    tilt = float(first.axis[2])
    assert abs(axes[0] @ axes[1]) == pytest.approx(tilt**2, abs=1e-9)
    np.testing.assert_allclose(S[0] @ R[0].T, rotation_from_vector(np.array([0, 0, np.pi / 2])))


def test_the_view_of_a_mounted_specimen_is_turned_with_it() -> None:
    options = replace(STILL, width_px=800, height_px=300, databar=False)
    quarter = replace(options, mount_deg=90.0)
    upright, turned = (view_of(o, motion_of(o)) for o in (options, quarter))
    assert turned.half_width == pytest.approx(upright.half_height)
    assert turned.half_height == pytest.approx(upright.half_width)


def test_another_series_is_of_the_same_specimen_with_other_motion_and_noise() -> None:
    first = random_streams(SynthesizeOptions(seed=3))
    second = random_streams(SynthesizeOptions(seed=3, series_seed=4))
    fourth = random_streams(SynthesizeOptions(seed=4))
    drawn = [[rng.random() for rng in streams] for streams in (first, second, fourth)]
    assert drawn[1] == [drawn[2][0], drawn[0][1], drawn[0][2], drawn[2][3]]
