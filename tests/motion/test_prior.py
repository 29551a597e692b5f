from __future__ import annotations

import json
from math import radians
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.tilt import parse_axis, tilt_prior
from semsfm_colmap.motion.prior import (
    TiltPrior,
    angles_about_common_axis,
    check_tilt,
    combine_tilt,
)
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries
from tests.ingest.conftest import DATA


def series(tilts_deg: list[float | None], source: str = "FEI 34682 [Stage] StageT") -> SemSeries:
    frames = tuple(
        SemFrame(
            name=f"{i}.tif", width_px=10, height_px=10, source_path="", crop_px=(0, 0, 10, 10),
            metadata=SemMetadata(
                tilt_rad=None if tilt is None else radians(tilt),
                source={} if tilt is None else {"tilt_rad": source},
            ),
        )
        for i, tilt in enumerate(tilts_deg)
    )  # fmt: skip
    return SemSeries(frames=frames)


def cameras(
    angles_deg: np.ndarray, noise_deg: float = 0.0, *, reversed_: bool = False
) -> np.ndarray:
    """Rotations about one oblique axis, seen from an arbitrary world frame."""
    axis = np.array([0.97, 0.2, -0.1])
    axis /= np.linalg.norm(axis)
    rng = np.random.default_rng(0)
    angles = np.radians(np.asarray(angles_deg) + noise_deg * rng.normal(size=len(angles_deg)))
    world = Rotation.from_rotvec([0.3, -1.0, 0.5])
    R = (Rotation.from_rotvec(angles[:, None] * axis) * world).as_matrix()
    if reversed_:
        D = np.diag([1.0, 1.0, -1.0])
        R = D @ R @ D
    return R


TILTS = np.arange(-30.0, 31.0, 5.0)


def prior_of(tilts_deg: np.ndarray, sigma_deg: float = 0.2) -> TiltPrior:
    result = tilt_prior(
        series(list(tilts_deg), "table s.csv"), IngestOptions(tilt_sigma_deg=sigma_deg)
    )
    assert result is not None
    return result


def names_of(prior: TiltPrior) -> tuple[str, ...]:
    return prior.image_names


def test_a_stage_and_a_table_give_priors_with_their_own_sigma() -> None:
    stage = tilt_prior(series([0, 5, 10]), IngestOptions())
    table = tilt_prior(series([0, 5, 10], "table s.csv"), IngestOptions())
    assert stage is not None
    assert table is not None
    assert stage.sigma_rad == pytest.approx(radians(0.5))
    assert table.sigma_rad == pytest.approx(radians(0.2))
    assert table.source == "table s.csv"
    assert stage.range_rad == pytest.approx(radians(10))
    chosen = tilt_prior(series([0, 5, 10]), IngestOptions(tilt_sigma_deg=1.5))
    assert chosen is not None
    assert chosen.sigma_rad == pytest.approx(radians(1.5))


def test_a_tilt_that_does_not_vary_is_no_prior() -> None:
    assert tilt_prior(series([12.0, 12.0, 12.1]), IngestOptions()) is None
    assert tilt_prior(series([None, None, None]), IngestOptions()) is None
    assert tilt_prior(series([None, 3.0, None]), IngestOptions()) is None


def test_a_nominal_step_is_used_only_without_recorded_tilts() -> None:
    by_step = tilt_prior(series([None] * 4), IngestOptions(tilt_step_deg=-3.0, tilt_axis="y"))
    assert by_step is not None
    np.testing.assert_allclose(np.degrees(by_step.angle_rad), [0, -3, -6, -9])
    assert by_step.sigma_rad == pytest.approx(radians(0.3))
    assert by_step.axis_image_rad == pytest.approx(radians(90))
    recorded = tilt_prior(series([0, 5, 10]), IngestOptions(tilt_step_deg=3.0))
    assert recorded is not None
    assert np.degrees(recorded.angle_rad[-1]) == pytest.approx(10)


def test_images_without_a_tilt_stay_unknown() -> None:
    prior = tilt_prior(series([0, None, 10]), IngestOptions())
    assert prior is not None
    assert np.isnan(prior.angle_rad[1])
    assert prior.range_rad == pytest.approx(radians(10))


@pytest.mark.parametrize(
    ("text", "value"), [("auto", None), ("x", 0.0), ("Y", radians(90)), ("-30", radians(-30))]
)
def test_the_axis_is_read(text: str, value: float | None) -> None:
    assert parse_axis(text) == (pytest.approx(value) if value is not None else None)


@pytest.mark.parametrize("text", ["z", "nan", "north"])
def test_no_other_axis_is_accepted(text: str) -> None:
    with pytest.raises(UsageError, match="tilt_axis"):
        parse_axis(text)


def test_a_sigma_that_is_not_positive_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="tilt_sigma_deg"):
        tilt_prior(series([0, 5, 10]), IngestOptions(tilt_sigma_deg=0.0))


def test_angles_about_the_axis_are_recovered_up_to_sign_and_offset() -> None:
    angles = np.degrees(angles_about_common_axis(cameras(TILTS)))
    sign = np.sign(angles[-1] - angles[0])
    np.testing.assert_allclose(np.diff(sign * angles), np.diff(TILTS), atol=1e-9)


def test_angles_of_a_full_turn_are_unwrapped() -> None:
    turn = np.arange(0.0, 360.0, 10.0)
    angles = np.degrees(angles_about_common_axis(cameras(turn)))
    np.testing.assert_allclose(np.abs(np.diff(angles)), 10.0, atol=1e-9)


@pytest.mark.parametrize("reversed_", [False, True])
def test_right_tilts_are_consistent_in_either_hand(reversed_: bool) -> None:
    prior = prior_of(TILTS)
    check = check_tilt(prior, names_of(prior), cameras(TILTS, 0.1, reversed_=reversed_))
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.01)
    assert check.outliers == ()


@pytest.mark.parametrize("wrong", [0.8, 1.2])
def test_tilts_that_are_wrong_by_20_percent_are_noticed(wrong: float) -> None:
    prior = prior_of(TILTS * wrong)
    check = check_tilt(prior, names_of(prior), cameras(TILTS, 0.1))
    assert not check.consistent
    assert abs(check.factor) == pytest.approx(1 / wrong, rel=0.01)
    assert "not obeyed" in check.message


def test_the_zero_of_the_stage_does_not_matter() -> None:
    prior = prior_of(TILTS + 12.3)
    assert check_tilt(prior, names_of(prior), cameras(TILTS)).consistent


def test_over_a_small_range_a_contradiction_may_also_be_a_change_of_magnification() -> None:
    tilts = np.linspace(0, 8, 5)
    agreeing = prior_of(tilts * 1.1)
    assert check_tilt(agreeing, names_of(agreeing), cameras(tilts)).consistent
    prior = prior_of(tilts * 1.3)
    check = check_tilt(prior, names_of(prior), cameras(tilts))
    assert not check.consistent
    assert "a change of the magnification by 0.3% between the images would" in check.message
    wide = prior_of(TILTS * 1.2)
    assert "magnification" not in check_tilt(wide, names_of(wide), cameras(TILTS)).message


def test_the_tolerance_is_three_joint_sigmas_and_never_below_three_percent() -> None:
    for span, sigma in ((10.0, 0.2), (10.0, 2.0), (60.0, 0.2)):
        tilts = np.linspace(0, span, 5)
        prior = prior_of(tilts, sigma)
        check = check_tilt(prior, names_of(prior), cameras(tilts))
        known = sigma / np.sqrt(np.sum((tilts - tilts.mean()) ** 2))
        images = 0.0004 * 9000 / span**2
        assert check.factor_sigma == pytest.approx(known)
        assert check.tolerance == pytest.approx(max(0.03, 3 * np.hypot(known, images)))


def test_equal_tilts_of_what_is_left_say_nothing() -> None:
    prior = prior_of(np.array([0.0, 0.0, 0.0, 10.0]))
    check = check_tilt(prior, ["0.tif", "1.tif", "2.tif"], cameras(np.array([0.0, 5.0, 10.0])))
    assert check.consistent
    assert "do not differ" in check.message


@pytest.mark.parametrize("factor", [0.96, 1.0, 1.04])
def test_angles_are_stretched_toward_the_known_ones_by_their_weight(factor: float) -> None:
    tilts = np.linspace(0, 10, 3)
    for sigma, low, high in ((1e-4, 0.999, 1.0), (0.2, 0.5, 0.7), (50.0, 0.0, 1e-3)):
        prior = prior_of(tilts / factor, sigma)
        check = check_tilt(prior, names_of(prior), cameras(tilts))
        combined = combine_tilt(check, radians(10.0), radians(0.05))
        assert low <= combined.weight <= high
        assert combined.stretch == pytest.approx(factor**-combined.weight)
        images = np.hypot(0.05 / 10, 0.0004 * 9000 / 100)
        assert combined.sigma <= min(images, check.factor_sigma)
        joint = combined.sigma**-2
        assert joint == pytest.approx(images**-2 + check.factor_sigma**-2)


AXIS_SEEN_DEG = float(np.degrees(np.arctan2(0.2, 0.97)))
"""Of `cameras`."""


@pytest.mark.parametrize("reversed_", [False, True])
@pytest.mark.parametrize(
    ("said", "agrees"), [(11.6, True), (14.0, True), (-168.0, True), (20.0, False), (90.0, False)]
)
def test_the_axis_that_is_said_is_compared_with_the_one_seen(
    said: float, agrees: bool, reversed_: bool
) -> None:
    options = IngestOptions(tilt_axis=f"{said}")
    for tilts in (list(TILTS), [None] * len(TILTS)):
        prior = tilt_prior(series(tilts, "table s.csv"), options)
        assert prior is not None
        message = check_tilt(prior, names_of(prior), cameras(TILTS, reversed_=reversed_)).message
        assert f"the tilt axis lies at {AXIS_SEEN_DEG:.1f} degrees in the images" in message
        assert ("as said" in message) == agrees
        assert ("the images are believed" in message) != agrees
        assert ("the estimated tilt is" in message) == (tilts[0] is not None)


def test_over_a_wide_range_the_images_have_the_word() -> None:
    prior = prior_of(TILTS * 1.01)
    check = check_tilt(prior, names_of(prior), cameras(TILTS))
    assert combine_tilt(check, radians(60.0), radians(0.02)).weight < 0.12


def test_a_single_wrong_entry_is_named() -> None:
    wrong = TILTS.copy()
    wrong[4] += 7.0
    prior = prior_of(wrong)
    check = check_tilt(prior, names_of(prior), cameras(TILTS, 0.05))
    assert check.consistent
    assert check.outliers == ("4.tif",)


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
    prior = tilt_prior(series(nominal, "table s.csv"), IngestOptions())
    assert prior is not None
    check = check_tilt(prior, prior.image_names, R)
    assert check.consistent
    assert abs(check.factor) == pytest.approx(1.0, abs=0.005)
    wrong = tilt_prior(series([1.2 * v for v in nominal], "table s.csv"), IngestOptions())
    assert wrong is not None
    assert not check_tilt(wrong, wrong.image_names, R).consistent


def test_the_prior_of_a_prepared_series_comes_from_its_table(folder: Path, tmp_path: Path) -> None:
    from semsfm_colmap.ingest.prepare import prepare_series
    from tests.ingest.conftest import save, texture

    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    table = tmp_path / "s.csv"
    table.write_text("image,tilt_deg\n" + "".join(f"{i}.png,{7 * i}\n" for i in range(3)))
    options = IngestOptions(series_csv=table)
    prior = tilt_prior(prepare_series(folder, tmp_path / "p", options), options)
    assert prior is not None
    np.testing.assert_allclose(np.degrees(prior.angle_rad), [0, 7, 14])
