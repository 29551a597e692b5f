from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry import reduced
from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.band import BandMatrix
from semsfm_colmap.geometry.eliminated import (
    ReducedSystem,
    SolverOptions,
    evaluate,
    linearise,
    minimise,
)
from semsfm_colmap.geometry.losses import (
    LOSS_NUMBER,
    gaussian_constants,
    loss,
    weight,
)
from semsfm_colmap.geometry.losses_kernels import loss_of, weight_of
from semsfm_colmap.geometry.points import fit_points, residuals, solve_points, track_pointer
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.banded import solve_in_bands
from tests.oracles import geometry as oracle


@pytest.mark.parametrize("banded", [False, True])
@pytest.mark.parametrize("batch", [7, 10**6])
@pytest.mark.parametrize("free_affine", [False, True])
@pytest.mark.parametrize("free_scale", [False, True])
def test_reduced_system_is_the_schur_complement_of_the_full_one(
    free_scale, free_affine, batch, banded, monkeypatch
):
    monkeypatch.setattr(reduced, "BATCH_OBSERVATIONS", batch)
    if banded:
        solve_in_bands(monkeypatch)
    rng = np.random.default_rng(0)
    s = simulate_tracks(num_images=9, range_deg=70, num_tracks=40, track_window=3, rng=rng)
    obs = s.observations
    model = BundleModel.build(
        9, free_scale=free_scale, free_affine=free_affine, scale_sigma=0.01, affine_sigma=0.01
    )
    A, _ = model.cameras(s.cameras)
    J = model.jacobian(s.cameras, s.points, obs.image_idx, obs.track_idx)
    r, w = rng.normal(size=(len(obs), 2)), rng.uniform(0.2, 1.0, len(obs))
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    system = ReducedSystem.of(model, s.cameras, obs, pointer)
    assert (system.layout.num_blocks > 1) == banded
    pairs = system.pairs
    blocks, by_image = reduced.accumulate_blocks(
        lambda rows: J[rows], A, r, w, obs.image_idx, pointer, pairs, J.shape[2]
    )
    matrix = BandMatrix.zeros(system.layout)
    matrix.add_blocks(blocks, pairs.first, pairs.second, model.param_idx)
    H, g = matrix.toarray(), reduced.gradient_of(by_image, model.param_idx, model.num_params)
    H0, g0 = oracle.reduced_system(J, A, r, w, obs.image_idx, obs.track_idx, model.param_idx)
    assert np.allclose(H, H0, atol=1e-9 * np.abs(H0).max())
    assert np.allclose(g, g0, atol=1e-9 * np.abs(g0).max())


@pytest.mark.parametrize("batch", [50, 10**6])
def test_the_order_of_summing_changes_nothing(batch, monkeypatch):
    monkeypatch.setattr(reduced, "BATCH_OBSERVATIONS", batch)
    s = simulate_tracks(
        num_images=20, range_deg=90, num_tracks=200, track_window=5, rng=np.random.default_rng(8)
    )
    model = BundleModel.build(
        20, free_scale=True, free_affine=False, scale_sigma=0.01, affine_sigma=0.01
    )
    obs = s.observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    state = evaluate(
        model, s.cameras, obs, pointer, 0.3, SolverOptions(loss="cauchy"), np.ones(len(obs))
    )
    system = ReducedSystem.of(model, s.cameras, obs, pointer)
    before, g = linearise(model, state, obs, pointer, 0.3, system)
    monkeypatch.setattr(reduced, "MAX_SCATTERED_PAIRS", 0)
    system = ReducedSystem.of(model, s.cameras, obs, pointer)
    assert not np.array_equal(system.pairs.order, np.arange(obs.num_tracks))
    after, g_along = linearise(model, state, obs, pointer, 0.3, system)
    H, along = before.toarray(), after.toarray()
    assert np.allclose(along, H, atol=1e-12 * np.abs(H).max())
    assert np.allclose(g_along, g, atol=1e-12 * np.abs(g).max())


@pytest.mark.parametrize("name", ["squared", "huber", "cauchy"])
def test_the_cost_never_rises(name):
    rng = np.random.default_rng(1)
    s = simulate_tracks(
        num_images=6, range_deg=30, num_tracks=200, outlier_share=0.05, body="field", rng=rng
    )
    model = BundleModel.build(
        6, free_scale=True, free_affine=False, scale_sigma=0.01, affine_sigma=0.01
    )
    start = model.retract(s.cameras, 0.02 * rng.normal(size=model.num_params))
    end = minimise(model, start, s.observations, sigma_px=0.3, options=SolverOptions(loss=name))
    assert end.converged
    assert all(b < a for a, b in zip(end.costs, end.costs[1:], strict=False))


@pytest.mark.parametrize("name", ["squared", "huber", "cauchy"])
def test_a_loss_starts_like_the_square_and_its_weight_is_its_derivative(name):
    s = np.linspace(0.0, 50.0, 200) + 1e-3
    numeric = (loss(name, s + 1e-5, 2.0) - loss(name, s - 1e-5, 2.0)) / 2e-5
    assert np.allclose(weight(name, s, 2.0), numeric, atol=1e-6)
    assert loss(name, np.zeros(1), 2.0) == 0.0
    assert np.allclose(weight(name, np.full(1, 1e-9), 2.0), 1.0)
    width, number = 2.0, LOSS_NUMBER[name]
    assert np.allclose([loss_of(number, x, width**2) for x in s], loss(name, s, width))
    assert np.allclose([weight_of(number, x, width**2) for x in s], weight(name, s, width))


@pytest.mark.parametrize("name", ["squared", "huber", "cauchy"])
def test_points_fitted_in_one_pass_are_those_of_the_separate_steps(name):
    rng = np.random.default_rng(3)
    s = simulate_tracks(num_images=6, range_deg=30, num_tracks=150, outlier_share=0.1, rng=rng)
    obs, rounds = s.observations, 1 if name == "squared" else 3
    A, t = s.cameras.projection, np.asarray(s.cameras.translation_px)
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    sigma = rng.uniform(0.2, 0.6, len(obs))
    w = np.ones(len(obs))
    X, r, fitted, cost = fit_points(
        A, t, obs.image_idx, pointer, obs.xy, sigma**-2, w,
        loss=name, loss_width=2.0, rounds=rounds,
    )  # fmt: skip
    for _ in range(rounds):
        X0 = np.nan_to_num(solve_points(A, t, obs.image_idx, pointer, obs.xy, w / sigma**2))
        r0 = residuals(A, t, X0, obs.image_idx, obs.track_idx, obs.xy)
        squared = np.sum(r0 * r0, axis=1) / sigma**2
        w = weight(name, squared, 2.0)
    assert np.allclose(X, X0, atol=1e-9)
    assert np.allclose(r, r0, atol=1e-9)
    assert np.allclose(fitted, w, atol=1e-9)
    assert np.isclose(cost, loss(name, squared, 2.0).sum())


@pytest.mark.parametrize("free_affine", [False, True])
def test_a_banded_system_takes_the_same_steps_as_a_dense_one(free_affine, monkeypatch):
    s = simulate_tracks(
        num_images=30, range_deg=90, num_tracks=300, track_window=5, rng=np.random.default_rng(4)
    )
    model = BundleModel.build(
        30, free_scale=True, free_affine=free_affine, scale_sigma=0.01, affine_sigma=0.01
    )
    start = model.retract(s.cameras, 0.003 * np.random.default_rng(5).normal(size=model.num_params))
    options = SolverOptions(cost_tolerance=1e-12)
    dense = minimise(model, start, s.observations, sigma_px=0.3, options=options)
    solve_in_bands(monkeypatch)
    thin = minimise(model, start, s.observations, sigma_px=0.3, options=options)
    assert np.isclose(thin.cost, dense.cost, rtol=1e-9)
    steps = min(len(thin.costs), len(dense.costs))
    assert np.allclose(thin.costs[:steps], dense.costs[:steps], rtol=1e-6)


def test_noise_given_for_each_observation_weighs_it():
    rng = np.random.default_rng(6)
    s = simulate_tracks(num_images=8, range_deg=60, num_tracks=300, noise_px=0.0, rng=rng)
    sigma = np.where(rng.random(len(s.observations)) < 0.5, 0.1, 2.0)
    noisy = s.observations.xy + sigma[:, None] * rng.normal(size=(len(sigma), 2))
    alike = replace(s.observations, xy=noisy)
    model = BundleModel.build(
        8, free_scale=False, free_affine=False, scale_sigma=1.0, affine_sigma=1.0
    )

    def error(obs):
        end = minimise(model, s.cameras, obs, sigma_px=1.0)
        R, R0 = np.asarray(end.params.cam_from_world), np.asarray(s.cameras.cam_from_world)
        return float(np.mean(rotation_angle(R @ align_rotations(R, R0) @ R0.mT)))

    assert error(replace(alike, relative_sigma=sigma)) < 0.4 * error(alike)


@pytest.mark.parametrize("name", ["huber", "cauchy"])
def test_the_constants_of_a_loss_are_those_of_simulated_noise(name):
    rng = np.random.default_rng(0)
    r = rng.normal(size=(400_000, 2))
    s = np.sum(r * r, axis=1)
    w = weight(name, s, 2.0)
    slope = (weight(name, s + 1e-5, 2.0) - w) / 1e-5
    a, b = np.mean(w + slope * s), np.mean(w * w * s) / 2.0
    constants = gaussian_constants(name, 2.0)
    assert np.isclose(constants.gain, a / b, rtol=5e-3)
    assert np.isclose(constants.efficiency, a * a / b, rtol=5e-3)
    assert 0.85 < constants.efficiency < 1.0
