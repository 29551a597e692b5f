"""The last adjustment of a guided pass on simulated series whose frames drift."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.mapping.drift import adjust_last
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.trust import covariance_of
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.refinement.test_scan_drift import HEIGHT, with_drift

M, DRIFT_PX, NOISE_PX = 12, 0.2, 0.1
OPTIONS = RefinementOptions(drift_sigma_px=DRIFT_PX, drag_sigma_px=0.0)


def series(seed):
    """A drifting series, its first refinement, and its observations."""
    rng = np.random.default_rng(seed)
    s = simulate_tracks(
        num_images=M, range_deg=60.0, num_tracks=800, noise_px=NOISE_PX, body="field", rng=rng
    )
    s = with_drift(s, DRIFT_PX * rng.normal(size=(M, 2)))
    first = refine(s.cameras, np.arange(M), s.observations, OPTIONS, rng=rng, seed=seed).value
    return s, first, s.observations


def last(seed, options=OPTIONS):
    s, first, observations = series(seed)
    context = SeriesContext(
        image_names=tuple(f"{i}.png" for i in range(M)),
        image_size_px=np.full((M, 2), HEIGHT),
        factorization=FactorizationOptions(),
        refinement=options,
    )
    end = adjust_last(context, first, observations)
    return s, first, end


@pytest.fixture(scope="module")
def ends():
    return [last(seed) for seed in range(8)]


def errors_deg(fit, s):
    return best_hand_errors_deg(fit.cameras.cam_from_world, s.cameras.cam_from_world)


def test_the_cameras_come_nearer_to_the_truth(ends):
    before = np.array([errors_deg(first, s) for s, first, _ in ends])
    after = np.array([errors_deg(end.refined, s) for s, _, end in ends])
    assert np.sqrt(np.mean(after**2)) < 0.7 * np.sqrt(np.mean(before**2))


def test_the_error_bars_hold_the_uncertainty_of_the_drift(ends):
    normalised, blind = [], []
    for s, _, end in ends:
        error = errors_deg(end.refined, s)
        for sigma_px, into in ((DRIFT_PX, normalised), (0.0, blind)):
            known = Displacement(drift_px=end.displacement.drift_px, drift_sigma_px=sigma_px)
            sigma = covariance_of(end.refined, np.full(M, HEIGHT), known).sigma_rotation_rad
            variance = np.sum(np.rad2deg(sigma) ** 2, axis=1)
            into.append(error**2 / variance)
    assert 0.5 < np.mean(normalised) < 1.6
    # error bars that know nothing of drift are too short by far
    assert np.mean(blind) > 2.0 * np.mean(normalised)


def test_the_residuals_sink_to_the_noise(ends):
    for _, first, end in ends:
        assert end.refined.sigma_px < first.sigma_px
        assert end.refined.sigma_px == pytest.approx(NOISE_PX, rel=0.1)


def test_the_observations_are_moved_by_no_more_than_half_the_drift(ends):
    for s, _, end in ends:
        moved = np.abs(end.observations.xy - s.observations.xy)
        limit = 0.51 * np.abs(end.displacement.drift_px)[s.observations.image_idx]
        assert (moved <= limit + 1e-3).mean() > 0.99


def test_a_prior_of_zero_takes_nothing_out():
    s, _, end = last(0, replace(OPTIONS, drift_sigma_px=0.0))
    assert not end.displacement.drift_px.any()
    np.testing.assert_array_equal(end.observations.xy, s.observations.xy)
