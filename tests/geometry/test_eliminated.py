import numpy as np
import pytest

from semsfm_colmap.geometry.eliminated import SolverOptions, minimise, reduced_system
from semsfm_colmap.geometry.losses import loss, weight
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.oracles import geometry as oracle


@pytest.mark.parametrize("free_affine", [False, True])
@pytest.mark.parametrize("free_scale", [False, True])
def test_reduced_system_is_the_schur_complement_of_the_full_one(free_scale, free_affine):
    rng = np.random.default_rng(0)
    s = simulate_tracks(num_images=5, range_deg=40, num_tracks=40, rng=rng)
    obs = s.observations
    model = BundleModel.build(
        5, free_scale=free_scale, free_affine=free_affine, scale_sigma=0.01, affine_sigma=0.01
    )
    A, _ = model.cameras(s.cameras)
    J = model.jacobian(s.cameras, s.points, obs.image_idx, obs.track_idx)
    r, w = rng.normal(size=(len(obs), 2)), rng.uniform(0.2, 1.0, len(obs))
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    H, g = reduced_system(J, A, r, w, obs.image_idx, pointer, model.param_idx, model.num_params)
    H0, g0 = oracle.reduced_system(J, A, r, w, obs.image_idx, obs.track_idx, model.param_idx)
    assert np.allclose(H, H0, atol=1e-9 * np.abs(H0).max())
    assert np.allclose(g, g0, atol=1e-9 * np.abs(g0).max())


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
