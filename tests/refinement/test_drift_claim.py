"""When a drift within the frames is a finding."""

import numpy as np
import pytest

from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.drift_claim import DriftClaim, judge_drift, roughness
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.refinement.test_scan_drift import HEIGHT, with_drift

M = 12


def series(seed=0, scale_drift=0.0):
    return simulate_tracks(
        num_images=M,
        range_deg=60.0,
        num_tracks=600,
        noise_px=0.15,
        body="field",
        scale_drift=scale_drift,
        rng=np.random.default_rng(seed),
    )


def claim(s, *, scanned, scale_sigma=0.001):
    settings = BundleSettings(sigma_px=0.15, drift_sigma_px=0.2, scale_sigma=scale_sigma)
    return judge_drift(
        s.cameras, s.observations, np.full(M, float(HEIGHT)), settings, scanned=scanned
    )


@pytest.mark.parametrize("scanned", [True, False])
def test_frames_without_drift_make_no_claim(scanned):
    for seed in range(3):
        found = claim(series(seed), scanned=scanned)
        assert found.gain < 3.0
        assert not found.holds


@pytest.mark.parametrize("scanned", [True, False])
def test_a_drift_of_each_frame_is_found(scanned):
    s = with_drift(series(), 0.4 * np.random.default_rng(1).normal(size=(M, 2)))
    assert claim(s, scanned=scanned).holds


@pytest.mark.parametrize("scanned", [True, False])
def test_a_smooth_course_is_no_drift_however_well_it_fits(scanned):
    assert not DriftClaim(gain=100.0, roughness=0.05, scanned=scanned).holds


def test_magnifications_with_a_prior_as_wide_are_no_drift():
    assert not claim(series(scale_drift=0.03), scanned=False, scale_sigma=0.03).holds


def test_without_a_scanning_instrument_more_is_asked_for():
    assert DriftClaim(gain=6.0, roughness=1.0, scanned=True).holds
    assert not DriftClaim(gain=6.0, roughness=1.0, scanned=False).holds
    few = float("nan")
    assert DriftClaim(gain=6.0, roughness=few, scanned=True).holds
    assert not DriftClaim(gain=100.0, roughness=few, scanned=False).holds


def test_the_roughness_is_one_for_independent_frames_and_zero_for_a_smooth_course():
    rng = np.random.default_rng(0)
    assert roughness(rng.normal(size=(400, 2))) == pytest.approx(1.0, abs=0.15)
    assert roughness(np.linspace(0, 1, 40)[:, None]) < 0.02
    assert np.isnan(roughness(rng.normal(size=(4, 2))))
