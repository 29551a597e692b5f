from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.oracles.geometry import numeric_jacobian


@pytest.mark.parametrize("free_affine", [False, True])
def test_derivatives_agree_with_finite_differences(free_affine):
    rng = np.random.default_rng(0)
    s = simulate_tracks(num_images=4, range_deg=50, num_tracks=30, rng=rng, scale_drift=0.01)
    cameras = replace(s.cameras, aspect=1.02, skew=0.03)
    model = BundleModel.build(
        4, free_scale=True, free_affine=free_affine, scale_sigma=0.01, affine_sigma=0.01
    )
    obs = s.observations

    def predict(step):
        moved = model.retract(cameras, step)
        return moved.project(s.points[obs.track_idx], obs.image_idx)

    numeric = numeric_jacobian(predict, np.zeros(model.num_params))
    local = model.jacobian(cameras, s.points, obs.image_idx, obs.track_idx)
    full = np.zeros_like(numeric)
    for o in range(len(obs)):
        full[o][:, model.param_idx[obs.image_idx[o]]] = local[o]
    assert np.allclose(full, numeric, atol=1e-4 * np.abs(numeric).max())

    r, J = model.prior(cameras)
    numeric = numeric_jacobian(
        lambda step: model.prior(model.retract(cameras, step))[0], np.zeros(model.num_params)
    )
    assert np.allclose(J.toarray(), numeric, atol=1e-4 * np.abs(numeric).max())
    assert len(r) == (6 if free_affine else 4)


@pytest.mark.parametrize("model", ["orthographic", "scaled_orthographic", "affine"])
def test_exact_data_are_fitted_exactly_by_every_camera_model(model):
    rng = np.random.default_rng(1)
    s = simulate_tracks(num_images=6, range_deg=60, num_tracks=200, noise_px=0.0, rng=rng)
    start = BundleModel.build(6, free_scale=False, free_affine=False, scale_sigma=1, affine_sigma=1)
    moved = start.retract(s.cameras, 0.01 * rng.normal(size=start.num_params))
    fit = bundle_adjust(
        moved,
        s.observations,
        BundleSettings(
            camera_model=model, solver=SolverOptions(max_iterations=60, cost_tolerance=1e-14)
        ),
    )
    assert (
        best_hand_errors_deg(fit.value.cameras.cam_from_world, s.cameras.cam_from_world).max()
        < 1e-4
    )
    assert fit.costs[-1] < 1e-6


def test_a_scale_prior_ties_the_magnifications_together():
    rng = np.random.default_rng(2)
    s = simulate_tracks(
        num_images=8, range_deg=60, num_tracks=500, noise_px=0.3, scale_drift=0.01, rng=rng
    )
    spread = {}
    for sigma in (1e-6, 1e-1):
        fit = bundle_adjust(s.cameras, s.observations, BundleSettings(scale_sigma=sigma))
        spread[sigma] = np.std(np.log(fit.value.cameras.scale_px_per_unit))
    assert spread[1e-6] < 2e-4
    true = np.std(np.log(s.cameras.scale_px_per_unit))
    assert 0.95 * true < spread[1e-1] < 1.05 * true


def two_series(ratio, seed=3):
    """Two series of one body about perpendicular axes, at magnifications 1 and `ratio`."""
    rng = np.random.default_rng(seed)
    s = simulate_tracks(num_images=12, range_deg=60, num_tracks=400, noise_px=0.0, rng=rng)
    series = np.repeat([0, 1], 6)
    quarter = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    R = np.concatenate([s.cameras.cam_from_world[::2], s.cameras.cam_from_world[1::2] @ quarter])
    cameras = replace(
        s.cameras,
        cam_from_world=R,
        scale_px_per_unit=s.cameras.scale_px_per_unit * np.where(series == 1, ratio, 1.0),
        series_idx=series,
    )
    obs = s.observations
    xy = cameras.project(s.points[obs.track_idx], obs.image_idx)
    return cameras, replace(obs, xy=xy + 0.3 * rng.normal(size=xy.shape)), s.points


@pytest.mark.parametrize("ratio", [1.0, 1.7, 4.0])
def test_two_series_keep_a_ratio_of_magnifications_that_the_prior_says_nothing_about(ratio):
    cameras, obs, _ = two_series(ratio)
    start = replace(cameras, scale_px_per_unit=np.where(cameras.series_idx == 1, 1.1 * ratio, 1.0))
    fit = bundle_adjust(start, obs, BundleSettings(scale_sigma=0.001, sigma_px=0.3)).value
    log_scale = np.log(fit.cameras.scale_px_per_unit)
    means = [log_scale[cameras.series_idx == k].mean() for k in (0, 1)]
    assert abs(means[1] - means[0] - np.log(ratio)) < 3e-4
    assert max(np.std(log_scale[cameras.series_idx == k]) for k in (0, 1)) < 3e-4
    errors = best_hand_errors_deg(fit.cameras.cam_from_world, cameras.cam_from_world)
    assert errors.max() < 0.05
    # where the series are not told apart the same prior bends the angles
    if ratio != 1.0:
        one = replace(start, series_idx=None)
        bent = bundle_adjust(one, obs, BundleSettings(scale_sigma=0.001, sigma_px=0.3)).value
        errors = best_hand_errors_deg(bent.cameras.cam_from_world, cameras.cam_from_world)
        assert errors.max() > 0.1


def test_the_prior_of_several_series_is_that_of_the_best_magnifications_of_theirs():
    """The oracle minimises over the magnification of each series; its gradient is J^T r."""
    cameras, _, _ = two_series(1.7)
    rng = np.random.default_rng(4)
    scale = cameras.scale_px_per_unit * np.exp(0.01 * rng.normal(size=12))
    params = replace(cameras, scale_px_per_unit=scale)
    model = BundleModel.build(
        12, free_scale=True, free_affine=False, scale_sigma=0.01, affine_sigma=1.0
    )

    def best_cost(log_scale):
        cost = 12 * (log_scale.mean() / 0.01) ** 2
        for k in (0, 1):
            mine = log_scale[cameras.series_idx == k]
            free = minimize_scalar(lambda g, x=mine: np.sum(((x - g) / 0.01) ** 2))
            cost += free.fun
        return cost

    r, J = model.prior(params)
    assert r @ r == pytest.approx(best_cost(np.log(scale)), rel=1e-9)
    own = model.param_idx[:, 3]
    for i in (0, 7):
        step = np.zeros(12)
        step[i] = 1e-4
        log_scale = np.log(scale)
        slope = (best_cost(log_scale + step) - best_cost(log_scale - step)) / 2e-4
        assert 2.0 * (J.T @ r)[own[i]] == pytest.approx(slope, rel=1e-5)


def test_the_orthographic_model_has_one_magnification_a_series():
    cameras, obs, _ = two_series(1.7)
    settings = BundleSettings(camera_model="orthographic", sigma_px=0.3)
    scale = bundle_adjust(cameras, obs, settings).value.cameras.scale_px_per_unit
    assert np.ptp(scale[:6]) == np.ptp(scale[6:]) == 0.0
    assert scale[6] / scale[0] == pytest.approx(1.7, rel=1e-9)
