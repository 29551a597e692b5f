from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.planning.next_angles import (
    candidate_angles,
    facing,
    mapped_series,
    next_angles,
    with_image,
)
from semsfm_colmap.planning.options import GivenNoise, NextOptions, NoiseOptions
from tests.exports.ball_project import ANGLES, NOISE_PX, UNIT, ball, image_names

GIVEN, NOISE = GivenNoise(), NoiseOptions()


@pytest.fixture(scope="module")
def model():
    return ball(image_names(False))


@pytest.fixture(scope="module")
def series(model):
    return mapped_series(model, GIVEN, NOISE)


def test_a_model_in_micrometres_becomes_one_in_pixels_with_the_noise_of_its_residuals(series):
    scale = series.geometry.cameras.scale_px_per_unit
    assert np.exp(np.mean(np.log(scale))) == pytest.approx(1.0)
    assert series.noise.noise_px == pytest.approx(NOISE_PX, rel=0.1)
    assert 0.0 < series.matched_share <= 1.0
    length = np.linalg.norm(series.geometry.normals, axis=1)
    np.testing.assert_allclose(length, 1.0)


def test_the_error_bars_do_not_depend_on_the_unit_of_the_world(model, series):
    scale = model.cameras.scale_px_per_unit * UNIT
    other = replace(
        model,
        points=model.points / UNIT,
        cameras=replace(model.cameras, scale_px_per_unit=scale),
    )
    options = NextOptions(num_added=1, from_deg=0.0, to_deg=20.0)
    first = next_angles(series, options)
    second = next_angles(mapped_series(other, GIVEN, NOISE), options)
    np.testing.assert_allclose(second.tried_px, first.tried_px, rtol=1e-6)


def test_each_image_added_lowers_the_sigma_and_the_first_is_the_best_of_all(series):
    options = NextOptions(num_added=2, candidate_step_deg=20.0)
    found = next_angles(series, options)
    assert found.tried_deg[np.nanargmin(found.tried_px)] == found.added[0].angle_deg
    means = [found.before.mean_px, *(image.prediction.mean_px for image in found.added)]
    assert means[0] > means[1] > means[2]
    image = found.added[0]
    known = np.rad2deg(series.axis.angle_rad)[series.image_names.index(image.nearest)]
    assert known + image.from_nearest_deg == pytest.approx(image.angle_deg)


def test_the_worst_points_are_helped_by_another_criterion(series):
    some = {"num_added": 1, "candidate_step_deg": 20.0}
    mean = next_angles(series, NextOptions(**some)).added[0].prediction
    worst = next_angles(series, NextOptions(**some, criterion="worst")).added[0].prediction
    assert worst.worst_px <= mean.worst_px
    assert mean.mean_px <= worst.mean_px


def test_an_image_is_turned_about_the_axis_and_shows_what_faces_it(series):
    at = float(np.rad2deg(series.axis.angle_rad)[3]) + 4.0
    geometry = with_image(series.geometry, series, at)
    assert geometry is not None
    R = np.asarray(geometry.cameras.cam_from_world)
    assert np.rad2deg(rotation_angle(R[-1] @ R[3].T)) == pytest.approx(4.0)
    obs = geometry.observations
    assert np.all(np.diff(obs.track_idx) >= 0)
    shown = obs.track_idx[obs.image_idx == len(R) - 1]
    expected = facing(geometry.normals, R[-1:], NOISE.visible_deg)[:, 0]
    np.testing.assert_array_equal(shown, np.flatnonzero(expected))
    rest = obs.select(obs.image_idx < len(R) - 1)
    np.testing.assert_array_equal(rest.xy, series.geometry.observations.xy)
    new = obs.select(obs.image_idx == len(R) - 1)
    np.testing.assert_allclose(new.precision, series.matched_share)


def test_angles_from_which_the_model_is_not_seen_are_not_added(series):
    behind = float(np.mean(ANGLES)) + 180.0
    assert with_image(series.geometry, series, behind) is None
    options = NextOptions(
        num_added=1, from_deg=behind - 5.0, to_deg=behind + 5.0, max_from_nearest_deg=180.0
    )
    with pytest.raises(InputError, match="sees the model"):
        next_angles(series, options)


def test_no_image_is_added_further_away_than_matches_are_found(series):
    last = float(np.rad2deg(series.axis.angle_rad).max())
    options = NextOptions(
        num_added=2, from_deg=last + 5.0, to_deg=last + 30.0, candidate_step_deg=4.0,
        max_from_nearest_deg=12.0,
    )  # fmt: skip
    found = next_angles(series, options)
    near = found.tried_deg <= last + 12.0
    np.testing.assert_array_equal(np.isfinite(found.tried_px), near)
    there = [last]
    for image in found.added:
        assert min(abs(image.angle_deg - angle) for angle in there) <= 12.0
        there.append(image.angle_deg)
    # the second one goes on from the first
    assert max(there) > last + 12.0


def test_candidates_are_multiples_of_the_step_within_less_than_a_turn(series):
    options = NextOptions(from_deg=-12.0, to_deg=900.0, candidate_step_deg=10.0)
    angles = candidate_angles(series.axis, options)
    np.testing.assert_allclose(angles, np.arange(-10.0, 350.0, 10.0))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (NextOptions(from_deg=20.0, to_deg=10.0), "--from_deg"),
        (NextOptions(from_deg=11.0, to_deg=12.0), "no multiple"),
    ],
)
def test_ranges_without_an_angle_are_refused(options, word, series):
    with pytest.raises(UsageError, match=word):
        candidate_angles(series.axis, options)


def test_a_model_in_which_nothing_turns_is_refused(model):
    R = np.tile(np.eye(3), (len(model.cameras), 1, 1))
    still = replace(model, cameras=replace(model.cameras, cam_from_world=R))
    with pytest.raises(InputError, match="nothing turns"):
        mapped_series(still, GIVEN, NOISE)


def test_a_model_of_few_points_is_refused(model):
    few = replace(model, inlier=model.observations.track_idx < 20)
    with pytest.raises(InputError, match="points that three images see"):
        mapped_series(few, GIVEN, NOISE)
