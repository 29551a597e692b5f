import numpy as np
import pytest

from semsfm_colmap.motion.readout import (
    MIN_READOUTS,
    fit_readout,
    follow_readout,
    run_direction,
)

FACTOR = np.radians(171.3)
RUN = np.linspace(0.0, 1.0, 20)
THERE_AND_BACK = np.concatenate([RUN, RUN[::-1]])


def test_a_clean_line_is_found_exactly():
    line = fit_readout(RUN, FACTOR * RUN + 0.3)
    assert line.slope == pytest.approx(FACTOR, rel=1e-12)
    assert line.offset_rad == pytest.approx(0.3, abs=1e-12)
    np.testing.assert_allclose(line.residual_rad, 0.0, atol=1e-12)
    assert line.hysteresis_rad is None
    assert line.is_straight
    assert not line.outlier.any()


def test_the_slope_is_ordinary_least_squares_where_all_residuals_are_small():
    # alternating errors of one size: none is down-weighted by a robust scale of 1.48 times it
    angle = FACTOR * RUN + 0.01 * (-1.0) ** np.arange(len(RUN))
    slope, offset = np.polyfit(RUN, angle, 1)
    line = fit_readout(RUN, angle)
    assert line.slope == pytest.approx(slope, rel=1e-9)
    assert line.offset_rad == pytest.approx(offset, abs=1e-9)


def test_the_sigma_of_independent_errors_is_the_textbook_one():
    rng = np.random.default_rng(1)
    sigma, lines = 0.004, []
    for _ in range(300):
        lines.append(fit_readout(RUN, FACTOR * RUN + sigma * rng.normal(size=len(RUN))))
    textbook = sigma / np.sqrt(np.sum((RUN - RUN.mean()) ** 2))
    assert np.median([line.slope_sigma for line in lines]) == pytest.approx(textbook, rel=0.12)
    assert np.std([line.slope for line in lines]) == pytest.approx(textbook, rel=0.15)


def test_a_common_stretch_of_the_angles_is_in_the_sigma_though_no_residual_shows_it():
    angle = FACTOR * RUN
    stretch = 0.002
    covariance = stretch**2 * np.outer(angle - angle.mean(), angle - angle.mean())
    line = fit_readout(RUN, angle, covariance)
    assert line.slope_sigma == pytest.approx(stretch * FACTOR, rel=1e-6)
    assert fit_readout(RUN, angle).slope_sigma < 1e-6


def test_pulls_of_slope_and_hysteresis_have_unit_size_with_correlated_and_own_errors():
    rng = np.random.default_rng(2)
    way = np.repeat([1.0, -1.0], 20)
    lag, stretch, own = np.radians(2.0), 0.001, np.radians(0.15)
    clean = FACTOR * THERE_AND_BACK + 0.5 * lag * way
    centred = clean - clean.mean()
    covariance = stretch**2 * np.outer(centred, centred)
    pulls = []
    for _ in range(300):
        angle = clean + stretch * rng.normal() * centred + own * rng.normal(size=40)
        line = fit_readout(THERE_AND_BACK, angle, covariance)
        pulls.append(
            (
                (line.slope - FACTOR) / line.slope_sigma,
                (line.hysteresis_rad - lag) / line.hysteresis_sigma_rad,
            )
        )
    size = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((size > 0.85) & (size < 1.2))


def test_one_wrong_readout_is_named_and_does_not_bend_the_line():
    rng = np.random.default_rng(3)
    angle = FACTOR * RUN + np.radians(0.1) * rng.normal(size=len(RUN))
    wrong = RUN.copy()
    wrong[7] += 0.2
    line = fit_readout(wrong, angle)
    np.testing.assert_array_equal(np.flatnonzero(line.outlier), [7])
    assert abs(line.slope / FACTOR - 1.0) < 0.003


def test_a_bent_relation_is_told_from_a_straight_one():
    rng = np.random.default_rng(4)
    noise = np.radians(0.05) * rng.normal(size=len(RUN))
    x = 2.0 * RUN - 1.0
    bent = fit_readout(RUN, FACTOR * RUN + np.radians(1.0) * x**2 + noise)
    assert not bent.is_straight
    assert bent.bend_rad == pytest.approx(np.radians(1.0), abs=4 * bent.bend_sigma_rad)
    assert fit_readout(RUN, FACTOR * RUN + noise).is_straight


def test_directions_of_a_run_there_and_back_and_there_again():
    up, down = np.arange(6.0), np.arange(5.0)[::-1]
    np.testing.assert_array_equal(
        run_direction(np.concatenate([up, down, up[1:]])), [1] * 6 + [-1] * 5 + [1] * 5
    )
    np.testing.assert_array_equal(run_direction(-up), [-1] * 6)


def test_readout_noise_is_no_turning_point():
    rng = np.random.default_rng(5)
    x = np.arange(30.0) + 0.1 * rng.normal(size=30)
    x[10] = x[9] - 0.05
    np.testing.assert_array_equal(run_direction(x), np.ones(30))


def test_whole_turns_follow_the_readout_in_any_order():
    rng = np.random.default_rng(6)
    x = rng.permutation(np.linspace(0.0, 5.0, 60))
    angle = FACTOR * x
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    followed = follow_readout(wrapped, x)
    np.testing.assert_allclose(followed - followed[0], angle - angle[0], atol=1e-9)


def test_a_frame_a_whole_turn_off_is_put_onto_the_turn_of_the_line():
    angle = FACTOR * RUN
    off = angle.copy()
    off[5] += 2 * np.pi
    line = fit_readout(RUN, off)
    np.testing.assert_allclose(line.angle_rad, angle, atol=1e-9)


def test_too_few_or_equal_readouts_give_no_line():
    assert fit_readout(RUN[: MIN_READOUTS - 1], RUN[: MIN_READOUTS - 1]) is None
    assert fit_readout(np.ones(20), FACTOR * RUN) is None
