from __future__ import annotations

import json

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.motion.check import check_displacements, check_tilt, tilt_line
from tests.conftest import DATA
from tests.motion.turning import AXIS_SEEN_DEG, TILTS, cameras, prior_of


@pytest.mark.parametrize("reversed_", [False, True])
def test_right_tilts_are_consistent_in_either_hand(reversed_: bool) -> None:
    prior = prior_of(TILTS)
    check = check_tilt(prior, prior.image_names, cameras(TILTS, 0.1, reversed_=reversed_))
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.01)
    assert check.outliers == ()


@pytest.mark.parametrize("wrong", [0.8, 1.2])
def test_tilts_that_are_wrong_by_20_percent_are_noticed(wrong: float) -> None:
    prior = prior_of(TILTS * wrong)
    check = check_tilt(prior, prior.image_names, cameras(TILTS, 0.1))
    assert not check.consistent
    assert abs(check.factor) == pytest.approx(1 / wrong, rel=0.01)
    assert "not obeyed" in check.message


def test_the_zero_of_the_stage_does_not_matter() -> None:
    prior = prior_of(TILTS + 12.3)
    assert check_tilt(prior, prior.image_names, cameras(TILTS)).consistent


def test_over_a_small_range_a_contradiction_may_also_be_a_change_of_magnification() -> None:
    tilts = np.linspace(0, 8, 5)
    agreeing = prior_of(tilts * 1.1)
    assert check_tilt(agreeing, agreeing.image_names, cameras(tilts)).consistent
    prior = prior_of(tilts * 1.3)
    check = check_tilt(prior, prior.image_names, cameras(tilts))
    assert not check.consistent
    assert "a change of the magnification by 0.3% between the images would" in check.message
    wide = prior_of(TILTS * 1.2)
    assert "magnification" not in check_tilt(wide, wide.image_names, cameras(TILTS)).message


def test_the_tolerance_is_three_joint_sigmas_and_never_below_three_percent() -> None:
    for span, sigma in ((10.0, 0.2), (10.0, 2.0), (60.0, 0.2)):
        tilts = np.linspace(0, span, 5)
        prior = prior_of(tilts, sigma)
        check = check_tilt(prior, prior.image_names, cameras(tilts))
        known = sigma / np.sqrt(np.sum((tilts - tilts.mean()) ** 2))
        images = 0.0004 * 9000 / span**2
        assert check.factor_sigma == pytest.approx(known)
        assert check.tolerance == pytest.approx(max(0.03, 3 * np.hypot(known, images)))


def test_equal_tilts_of_what_is_left_say_nothing() -> None:
    prior = prior_of(np.array([0.0, 0.0, 0.0, 10.0]))
    check = check_tilt(prior, ["0.tif", "1.tif", "2.tif"], cameras(np.array([0.0, 5.0, 10.0])))
    assert check.consistent
    assert "do not differ" in check.message


@pytest.mark.parametrize("reversed_", [False, True])
@pytest.mark.parametrize(
    ("said", "agrees"), [(11.6, True), (14.0, True), (-168.0, True), (20.0, False), (90.0, False)]
)
def test_the_axis_that_is_said_is_compared_with_the_one_seen(
    said: float, agrees: bool, reversed_: bool
) -> None:
    for known in (True, False):
        prior = prior_of(TILTS if known else np.full(len(TILTS), np.nan), axis_deg=said)
        message = check_tilt(prior, prior.image_names, cameras(TILTS, reversed_=reversed_)).message
        assert f"the tilt axis lies at {AXIS_SEEN_DEG:.1f} degrees in the images" in message
        assert ("as said" in message) == agrees
        assert ("the images are believed" in message) != agrees
        assert ("the estimated tilt is" in message) == known


def test_a_single_wrong_entry_is_named() -> None:
    wrong = TILTS.copy()
    wrong[4] += 7.0
    prior = prior_of(wrong)
    check = check_tilt(prior, prior.image_names, cameras(TILTS, 0.05))
    assert check.consistent
    assert check.outliers == ("4.tif",)


def test_one_badly_placed_image_does_not_bend_the_factor() -> None:
    prior = prior_of(TILTS)
    R = cameras(TILTS, 0.05)
    R[9] = rotation_from_vector(np.radians([0.0, 8.0, 8.0])) @ R[9]
    check = check_tilt(prior, prior.image_names, R)
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.01)


def test_images_that_do_not_turn_have_a_factor_of_zero() -> None:
    tilts = np.linspace(0.0, 60.0, 5)
    check = check_tilt(prior_of(tilts), [f"{i}.tif" for i in range(5)], np.array([np.eye(3)] * 5))
    assert check.factor == 0.0


@pytest.mark.parametrize("known", [[], [0.0, 0.3], [0.1, 0.1, 0.101]])
def test_too_few_or_equal_tilts_make_no_line(known: list[float]) -> None:
    assert tilt_line(np.array(known), np.arange(len(known), dtype=float)) is None


def test_frames_that_were_not_registered_are_left_out_of_the_check() -> None:
    prior = prior_of(TILTS)
    keep = [0, 3, 7, 12]
    check = check_tilt(prior, [prior.image_names[i] for i in keep], cameras(TILTS)[keep])
    assert check.consistent
    few = check_tilt(prior, ["0.tif", "unknown"], cameras(TILTS)[:2])
    assert few.consistent
    assert "fewer than three" in few.message


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_the_nominal_tilts_of_the_rendered_nickel_fit_its_true_poses() -> None:
    truth = json.loads((DATA / "synth_nickel/truth.json").read_text())
    R = np.array([frame["R"] for frame in truth["frames"]])
    nominal = [frame["nominal_deg"] for frame in truth["frames"]]
    prior = prior_of(nominal)
    check = check_tilt(prior, prior.image_names, R)
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.005)
    wrong = prior_of([1.2 * v for v in nominal])
    assert not check_tilt(wrong, wrong.image_names, R).consistent


def test_displacements_in_proportion_are_said_with_their_factor():
    angles = np.arange(0.0, 120.0, 5.0)
    names = [f"{k}.tif" for k in range(len(angles))]
    said = check_displacements(angles / 150.0, names, cameras(angles))
    assert "follow the rotation: 150 degrees per um, 0.00 degrees off" in said


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda x, rng: x * (1 + 0.1 * rng.normal(size=len(x))), "do not follow the rotation"),
        (lambda x, rng: x * (1 + 0.1 * x / x.max()), "not in proportion"),
    ],
    ids=["each by 10 percent", "bent by 10 percent"],
)
def test_displacements_that_the_images_contradict_are_said_and_not_obeyed(wrong, said):
    angles = np.arange(0.0, 120.0, 5.0)
    names = [f"{k}.tif" for k in range(len(angles))]
    displacement = wrong(angles / 150.0, np.random.default_rng(0))
    sentence = check_displacements(displacement, names, cameras(angles, noise_deg=0.02))
    assert said in sentence
    assert "not obeyed" in sentence


def test_one_wrong_displacement_is_named_and_missing_ones_do_not_matter():
    angles = np.arange(0.0, 120.0, 5.0)
    names = [f"{k}.tif" for k in range(len(angles))]
    displacement = angles / 150.0
    displacement[5] += 0.3
    displacement[9] = np.nan
    sentence = check_displacements(displacement, names, cameras(angles, noise_deg=0.05))
    assert "follow the rotation" in sentence
    assert "that of 5.tif does not fit" in sentence


def test_a_constant_displacement_or_no_rotation_says_nothing():
    angles = np.arange(0.0, 120.0, 5.0)
    names = [f"{k}.tif" for k in range(len(angles))]
    assert check_displacements(np.ones(24), names, cameras(angles)) is None
    assert check_displacements(angles, names, cameras(0.0 * angles)) is None


def test_known_tilts_of_shuffled_images_over_a_turn_agree_with_the_seen_ones():
    tilts = np.random.default_rng(1).permutation(np.arange(0.0, 355.0, 5.0))
    names = [f"{k}.tif" for k in range(len(tilts))]
    check = check_tilt(prior_of(tilts), names, cameras(tilts, noise_deg=0.05))
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.001)
