"""Exposure, shot noise and the display curve."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.synthetic.detector import (
    BACKGROUND,
    MEDIAN_GREY,
    SHOULDER,
    charged,
    compressed,
    expose,
    exposure_of,
)
from semsfm_colmap.types import Array


def exposed(level: float, counts: float, psf_px: float = 0.0, size: int = 300) -> Array:
    signal = np.full((size, size), level, np.float32)
    return expose(
        signal,
        np.ones_like(signal),
        exposure=1.0,
        gain=1.0,
        psf_px=psf_px,
        counts=counts,
        rng=np.random.default_rng(0),
    )


def test_without_noise_a_grey_value_is_what_the_signal_says() -> None:
    assert np.unique(exposed(0.4, 0.0)).tolist() == [102]


def test_shot_noise_has_the_variance_of_the_counted_electrons() -> None:
    grey = exposed(0.4, 100.0) / 255.0
    assert grey.mean() == pytest.approx(0.4, rel=0.01)
    assert 0.97 * 0.04 < grey.std() < 1.05 * 0.04


def test_four_times_the_electrons_halve_the_noise() -> None:
    ratio = exposed(0.3, 100.0).std() / exposed(0.3, 400.0).std()
    assert 1.9 < ratio < 2.1


def test_the_beam_profile_blurs_the_specimen_not_the_noise() -> None:
    step = np.zeros((40, 40), np.float32)
    step[:, 20:] = 0.4
    args = {"exposure": 1.0, "gain": 1.0, "counts": 0.0, "rng": np.random.default_rng(0)}
    sharp = expose(step, np.ones_like(step), psf_px=0.0, **args).astype(float)  # type: ignore[arg-type]
    soft = expose(step, np.ones_like(step), psf_px=2.0, **args).astype(float)  # type: ignore[arg-type]
    assert np.diff(sharp[20]).max() == pytest.approx(102)
    # Slope of a Gaussian step of sigma 2.
    assert np.diff(soft[20]).max() == pytest.approx(102 / (2 * np.sqrt(2 * np.pi)), rel=0.05)
    assert exposed(0.4, 100.0, psf_px=3.0).std() > 0.97 * exposed(0.4, 100.0).std()


def test_the_exposure_brings_the_median_of_the_specimen_to_middle_grey() -> None:
    signal = np.zeros((20, 20))
    signal[5:15, 5:15] = 3.0
    coverage = (signal > 0).astype(float)
    assert exposure_of(signal, coverage) * 3.0 == pytest.approx(MEDIAN_GREY)


def test_an_empty_first_frame_leaves_a_usable_exposure() -> None:
    assert exposure_of(np.zeros((4, 4)), np.zeros((4, 4))) == MEDIAN_GREY


def test_the_empty_chamber_is_dark_but_not_black() -> None:
    zero = np.zeros((50, 50), np.float32)
    rng = np.random.default_rng(0)
    grey = expose(zero, zero, exposure=1.0, gain=1.0, psf_px=0.8, counts=0.0, rng=rng)
    assert np.median(grey) == pytest.approx(255 * BACKGROUND, abs=1)
    assert grey.min() > 0


def test_the_display_curve_is_linear_below_its_shoulder_and_never_reaches_white() -> None:
    x = np.linspace(0, 5, 501)
    y = compressed(x)
    below = x <= SHOULDER
    np.testing.assert_allclose(y[below], x[below])
    assert np.all(np.diff(y) > 0)
    assert y.max() < 1.0


def test_a_charged_specimen_is_dark_behind_its_bright_parts_along_the_scan_line() -> None:
    grey = np.full((60, 200), 0.2, np.float32)
    grey[30, 80:100] = 0.9
    charged_grey = charged(grey, 1.0, np.random.default_rng(0))
    clean = np.full((60, 200), 0.2, np.float32)
    without = charged(clean, 1.0, np.random.default_rng(0))
    ratio = charged_grey / without
    before, behind, later = ratio[30, 75], ratio[30, 102], ratio[30, 190]
    assert behind < 0.95 * before
    assert behind < 0.95 * later
    # it fades within a few lines
    assert ratio[31, 102] < ratio[36, 102] < ratio[50, 102]


def test_without_charge_nothing_changes() -> None:
    grey = np.random.default_rng(1).uniform(size=(20, 30)).astype(np.float32)
    np.testing.assert_array_equal(charged(grey, 0.0, np.random.default_rng(0)), grey)
