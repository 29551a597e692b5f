import numpy as np
import pytest

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.oracles.geometry import numeric_jacobian


@pytest.mark.parametrize("free_affine", [False, True])
def test_derivatives_agree_with_finite_differences(free_affine):
    rng = np.random.default_rng(0)
    s = simulate_tracks(num_images=4, range_deg=50, num_tracks=30, rng=rng, scale_drift=0.01)
    from dataclasses import replace

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
