"""Error bars in parts: what patches, drag and shading add to the noise."""

import numpy as np
import pytest

from semsfm_colmap.geometry.eliminated import minimise, precision_of
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.refinement.covariance import estimate_covariance
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.drag import seen_normals
from semsfm_colmap.refinement.shading import shading_fields
from semsfm_colmap.refinement.trust import (
    total_rotation_parts,
    total_rotation_sigma,
    uncertainty_of,
)
from semsfm_colmap.refinement.uncertainty import (
    apply_covariance,
    field_modes,
    grouped_pull,
    point_modes,
    relief_sigma,
    shared_mode,
    surface_patches,
)
from tests.dragged import dragged_scene, refined

HEIGHT = 400.0


@pytest.fixture(scope="module")
def fit():
    return refined(dragged_scene(0.0))


def full(value, **displacement):
    M = len(value.images)
    said = Displacement(drift_px=np.zeros((M, 2)), drift_sigma_px=0.0, **displacement)
    return uncertainty_of(value, np.full(M, HEIGHT), said)


def test_the_parts_add_up_and_no_total_is_below_the_noise(fit):
    found = full(fit, drag_prior_px=1.0, drag_doubt_px=0.2)
    parts = total_rotation_parts(fit, found)
    assert set(parts) == {"noise", "clustered", "drag", "shading"}
    assert total_rotation_sigma(fit, found) == pytest.approx(
        np.sqrt(sum(p**2 for p in parts.values()))
    )
    assert np.all(found.total.sigma_rotation_rad >= found.noise.sigma_rotation_rad)
    assert np.all(np.linalg.eigvalsh(found.total.points - found.noise.points) > -1e-9)


def test_independent_noise_pulls_the_patches_no_more_than_the_formal_error_says(fit):
    parts = total_rotation_parts(fit, full(fit))
    assert 0.5 < parts["clustered"] / parts["noise"] < 1.6


def test_errors_that_neighbours_share_lengthen_the_bars():
    rng = np.random.default_rng(3)
    waves = 0.02 * rng.normal(size=(8, 3))
    phase = 2 * np.pi * rng.random((8, 2))

    def shared(R, normals, image, track):
        # a field on the surface that turns with the view: no point explains it
        where = 500.0 * normals[track] @ waves.T
        turn = image[:, None] * 0.9
        return 0.15 * np.stack(
            [np.sin(where + phase[:, k] + turn).sum(axis=1) / 2 for k in range(2)], axis=1
        )

    value = refined(dragged_scene(0.0, extra=shared))
    parts = total_rotation_parts(value, full(value))
    assert parts["clustered"] > 1.3 * parts["noise"]


def test_a_drag_that_was_not_sought_is_all_in_the_bars(fit):
    blind = total_rotation_parts(fit, full(fit))["drag"]
    sought = total_rotation_parts(fit, full(fit, drag_prior_px=1.0, drag_doubt_px=0.2))["drag"]
    assert blind > 2.0 * sought


def test_the_mode_of_a_field_is_what_the_adjustment_does_with_it(fit):
    obs = fit.observations
    noise = estimate_covariance(fit.adjustment.model, fit.adjustment.state, obs, fit.sigma_px).value
    R = np.asarray(fit.cameras.cam_from_world)
    normals = seen_normals(fit.points, fit.cameras, obs)
    fields = shading_fields(R, normals, obs.image_idx, obs.track_idx)[:, :, :2]
    modes = field_modes(
        fit.adjustment.model, fit.adjustment.state, obs, fit.sigma_px, noise.cameras, fields
    )
    size = 0.05
    moved = type(obs)(
        **{name: getattr(obs, name) for name in obs.__dataclass_fields__}
        | {"xy": obs.xy + size * fields[:, :, 1]}
    )
    end = minimise(fit.adjustment.model, fit.cameras, moved, sigma_px=fit.sigma_px)
    turned = vector_from_rotation(np.asarray(end.params.cam_from_world) @ R.transpose(0, 2, 1))
    expected = size * modes[fit.adjustment.model.param_idx[:, :3], 1]
    # the gauge of the modes: no mean rotation of the world
    world = np.einsum("mji,mj->i", R, turned) / len(R)
    turned = turned - np.einsum("mij,j->mi", R, world)
    np.testing.assert_allclose(turned, expected, atol=0.1 * np.abs(expected).max())


def test_points_follow_the_cameras(fit):
    obs = fit.observations
    step = np.zeros((fit.adjustment.model.num_params, 1))
    step[fit.adjustment.model.param_idx[:, 4], 0] = 1.0
    moved = point_modes(fit.adjustment.model, fit.adjustment.state, obs, fit.sigma_px, step)
    # all images shifted to the right: points that move right in all of them do not exist, but each
    # stays where its rays meet best
    direct = fit.adjustment.model.retract(fit.cameras, 0.01 * step[:, 0])
    from semsfm_colmap.geometry.points import solve_points, track_pointer

    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    w = precision_of(fit.sigma_px, obs)
    after = solve_points(
        direct.projection, np.asarray(direct.translation_px), obs.image_idx, pointer, obs.xy, w
    )
    np.testing.assert_allclose(moved[:, :, 0], (after - fit.points) / 0.01, atol=0.02)


def test_pulls_of_all_groups_together_are_the_gradient(fit):
    obs, state = fit.observations, fit.adjustment.state
    J = fit.adjustment.model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    w = precision_of(fit.sigma_px, obs)
    patch = surface_patches(fit.points)
    assert patch.max() > 50
    pull = grouped_pull(
        J, state.residuals, w, fit.adjustment.model.param_idx, obs.image_idx, patch[obs.track_idx]
    )
    prior, derivative = fit.adjustment.model.prior(state.params)
    gradient = pull.sum(axis=1) + derivative.T @ prior
    noise = estimate_covariance(fit.adjustment.model, state, obs, fit.sigma_px).value
    assert np.abs(apply_covariance(noise.cameras, gradient)).max() < 1e-3


def test_a_shared_parameter_moves_by_one_with_its_own_mode(fit):
    noise = estimate_covariance(
        fit.adjustment.model, fit.adjustment.state, fit.observations, fit.sigma_px
    ).value
    follow, sigma = shared_mode(noise.cameras, 3)
    assert follow[3] == pytest.approx(1.0)
    assert sigma == pytest.approx(float(noise.sigma_scale[0]), rel=1e-6)


def test_rough_clouds_have_a_larger_relief():
    rng = np.random.default_rng(0)
    plane = np.column_stack([rng.uniform(0, 400, size=(2000, 2)), np.zeros(2000)])
    rough = plane + [0, 0, 1] * rng.normal(scale=3.0, size=(2000, 1))
    assert relief_sigma(plane) == pytest.approx(1.1, abs=0.01)
    assert relief_sigma(rough) > 2.0
