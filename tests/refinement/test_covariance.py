from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.eliminated import (
    ReducedSystem,
    SolverOptions,
    evaluate,
    linearise,
)
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.refinement import covariance
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.refinement.covariance import estimate_covariance, gauge_directions
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.banded import solve_in_bands
from tests.oracles import geometry as oracle

SIGMA_PX = 0.3


def a_turn(num_images=24, **options):
    return simulate_tracks(
        num_images=num_images,
        num_tracks=300,
        noise_px=SIGMA_PX,
        rng=np.random.default_rng(0),
        **{"range_deg": 120, "track_window": 6, **options},
    )


def state_of(s, *, free_affine=False, drift=False):
    base = BundleModel.build(
        s.observations.num_images,
        free_scale=True,
        free_affine=free_affine,
        scale_sigma=0.001,
        affine_sigma=0.003,
    )
    obs = s.observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    state = evaluate(base, s.cameras, obs, pointer, SIGMA_PX, SolverOptions(), np.ones(len(obs)))
    if not drift:
        return base, state
    height = np.full(obs.num_images, 1000.0)
    params = (s.cameras, np.zeros((obs.num_images, 2)))
    return ScanDriftModel.build(base, 0.2, height), replace(state, params=params)


@pytest.mark.parametrize("banded", [False, True])
@pytest.mark.parametrize("drift", [False, True])
@pytest.mark.parametrize("free_affine", [False, True])
def test_error_bars_are_those_of_the_whole_inverse(free_affine, drift, banded, monkeypatch):
    if banded:
        solve_in_bands(monkeypatch)
    s = a_turn()
    obs = s.observations
    model, state = state_of(s, free_affine=free_affine, drift=drift)
    found = estimate_covariance(model, state, obs, SIGMA_PX).value
    C, points = oracle.covariance(model, state, obs, SIGMA_PX)
    sigma = np.sqrt(np.diag(C))
    idx = model.param_idx
    assert np.allclose(found.sigma_rotation_rad, sigma[idx[:, :3]], rtol=1e-5)
    assert np.allclose(found.sigma_scale, sigma[idx[:, 3]], rtol=1e-5)
    assert np.allclose(found.sigma_translation_px, sigma[idx[:, 4:6]], rtol=1e-5)
    assert np.allclose(found.points, points, rtol=1e-5, atol=1e-6 * np.abs(points).max())
    for seed in range(3):
        d = np.random.default_rng(seed).normal(size=len(C))
        assert np.isclose(found.cameras.variance(d), d @ C @ d, rtol=1e-5)


def test_the_choice_of_images_that_hold_the_world_does_not_show(monkeypatch):
    s = a_turn()
    model, state = state_of(s)
    found = estimate_covariance(model, state, s.observations, SIGMA_PX).value
    hold = covariance.hold_world

    def others(S, N, viewing_direction, pairs, param_idx):
        other = np.flatnonzero(pairs.first != pairs.second)[:1]
        chosen = replace(pairs, first=pairs.first[other], second=pairs.second[other])
        return hold(S, N, viewing_direction, chosen, param_idx)

    monkeypatch.setattr(covariance, "hold_world", others)
    again = estimate_covariance(model, state, s.observations, SIGMA_PX).value
    assert np.allclose(again.sigma_rotation_rad, found.sigma_rotation_rad, rtol=1e-5)
    assert np.allclose(again.points, found.points, rtol=1e-5, atol=1e-9)


def test_turning_and_shifting_the_world_changes_nothing_in_the_reduced_system():
    s = a_turn()
    for drift in (False, True):
        model, state = state_of(s, drift=drift)
        obs = s.observations
        pointer = track_pointer(obs.track_idx, obs.num_tracks)
        system = ReducedSystem.of(model, state.params, obs, pointer)
        S, _ = linearise(model, state, obs, pointer, SIGMA_PX, system)
        A = S.toarray()
        N = gauge_directions(model, s.cameras)
        assert np.abs(A @ N).max() < 1e-9 * np.abs(A).max()


def test_an_image_without_observations_leaves_no_error_bars():
    s = a_turn()
    obs = replace(s.observations, num_images=25)
    cameras = s.cameras.select(np.append(np.arange(24), 0))
    s = replace(s, observations=obs, cameras=cameras)
    model, state = state_of(s)
    result = estimate_covariance(model, state, obs, SIGMA_PX)
    assert result.value is None
    assert result.status == "rank_deficient"
