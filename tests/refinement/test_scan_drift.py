from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.scan_drift import with_drift as seen_with_drift
from semsfm_colmap.geometry.scan_drift import without_drift
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.refinement.model_choice import DRIFT_RUNG, compare_models
from semsfm_colmap.refinement.scan_drift import ScanDriftModel, adjust_with_drift
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.oracles.geometry import numeric_jacobian

HEIGHT = 1000.0


def scene(num_images=16, range_deg=90.0, num_tracks=1500, **options):
    return simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=num_tracks,
        rng=np.random.default_rng(5),
        **options,
    )


def with_drift(s, drift):
    """The scene with each frame's rows displaced; the noise stays as it is."""
    obs = s.observations
    exact = s.cameras.project(s.points[obs.track_idx], obs.image_idx)
    row = (exact[:, 1:] - HEIGHT / 2) / HEIGHT
    return replace(s, observations=replace(obs, xy=obs.xy + row * drift[obs.image_idx]))


def model(M, sigma_px=0.5):
    return ScanDriftModel(
        base=BundleModel.build(
            M, free_scale=True, free_affine=False, scale_sigma=0.001, affine_sigma=1.0
        ),
        sigma_px=sigma_px,
        middle_row_px=np.full(M, HEIGHT / 2),
        height_px=np.full(M, HEIGHT),
    )


def test_derivatives_agree_with_finite_differences():
    s = scene(num_images=4, num_tracks=40)
    obs, drifting = s.observations, model(4)
    params = (s.cameras, np.random.default_rng(1).normal(size=(4, 2)) * 20)

    def predict(step):
        A, t = drifting.cameras(drifting.retract(params, step))
        i = obs.image_idx
        return np.einsum("oij,oj->oi", A[i], s.points[obs.track_idx]) + t[i]

    numeric = numeric_jacobian(predict, np.zeros(drifting.num_params))
    local = drifting.jacobian(params, s.points, obs.image_idx, obs.track_idx)
    full = np.zeros_like(numeric)
    for o in range(len(obs)):
        idx = drifting.param_idx[obs.image_idx[o]]
        full[o][:, idx[idx >= 0]] = local[o][:, idx >= 0]
    assert np.allclose(full, numeric, atol=1e-4 * np.abs(numeric).max())
    numeric = numeric_jacobian(
        lambda step: drifting.prior(drifting.retract(params, step))[0],
        np.zeros(drifting.num_params),
    )
    assert np.allclose(drifting.prior(params)[1].toarray(), numeric, atol=1e-4)


def adjusted(s, **options):
    settings = BundleSettings(**{"drift_sigma_px": 1.0, **options})
    fit = adjust_with_drift(
        s.cameras, s.observations, np.full(len(s.cameras), HEIGHT), settings
    ).value
    return fit.state.params


def test_a_simulated_drift_is_found_and_the_poses_gain_by_it():
    true = np.random.default_rng(2).normal(size=(16, 2)) * 1.0
    s = with_drift(scene(), true)
    cameras, drift = adjusted(s)
    # a drift common to all frames is an aspect and a skew of all
    rest = (drift - drift.mean(axis=0)) - (true - true.mean(axis=0))
    assert np.sqrt(np.mean(rest**2)) < 0.35 * np.sqrt(np.mean(true**2))
    without = adjusted(s, drift_sigma_px=1e-6)[0]
    truth = s.cameras.cam_from_world
    with_it = np.median(best_hand_errors_deg(cameras.cam_from_world, truth))
    assert with_it < np.median(best_hand_errors_deg(without.cam_from_world, truth))


def test_without_drift_the_rung_costs_nothing_and_a_tight_prior_is_the_plain_model():
    s = scene()
    truth = s.cameras.cam_from_world
    plain, zero = adjusted(s, drift_sigma_px=1e-6)
    assert np.abs(zero).max() < 1e-6
    cameras, drift = adjusted(s, drift_sigma_px=0.5)
    assert np.sqrt(np.mean(drift**2)) < 0.15
    error = [
        np.sqrt(np.mean(best_hand_errors_deg(c.cam_from_world, truth) ** 2))
        for c in (plain, cameras)
    ]
    assert error[1] < 1.3 * error[0]


@pytest.mark.parametrize(("size_px", "wins"), [(0.0, False), (1.5, True)])
def test_the_ladder_names_drift_where_there_is_some(size_px, wins):
    s = with_drift(scene(), size_px * np.random.default_rng(3).normal(size=(16, 2)))
    comparison = compare_models(
        s.cameras,
        s.observations,
        BundleSettings(drift_sigma_px=0.5),
        height_px=np.full(16, HEIGHT),
    )
    assert (comparison.best == DRIFT_RUNG) is wins
    assert bool(np.abs(comparison.drift_px).max() > 0.7) is wins


def test_without_drift_is_the_inverse_of_the_drift():
    s = scene(num_images=4, num_tracks=50)
    drift = np.random.default_rng(4).normal(size=(4, 2)) * 3.0
    obs, i = s.observations, s.observations.image_idx
    A, t = model(4).cameras((s.cameras, drift))
    seen = np.einsum("oij,oj->oi", A[i], s.points[obs.track_idx]) + t[i]
    ideal = without_drift(seen, drift[i], np.full(len(i), HEIGHT))
    assert np.allclose(ideal, s.cameras.project(s.points[obs.track_idx], i), atol=1e-9)
    assert np.allclose(seen_with_drift(ideal, drift[i], np.full(len(i), HEIGHT)), seen, atol=1e-9)
