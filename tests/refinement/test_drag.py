"""Features dragged down the slopes: found, told from rotation, and taken out."""

import numpy as np
import pytest

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.eliminated import minimise
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.refinement.displaced import find_displacement, without_displacement
from semsfm_colmap.refinement.drag import DragModel, doubt_px, drag_field, misfit_px, seen_normals
from semsfm_colmap.refinement.model_choice import total_rotation
from tests.dragged import dragged_scene, refined

HEIGHT = 400.0


def found(fit, **options):
    chosen = {"drift_sigma_px": 0.2, "drag_sigma_px": 1.0} | options
    settings = BundleSettings(sigma_px=fit.sigma_px, **chosen)
    return find_displacement(fit, np.full(len(fit.images), HEIGHT), settings)


def test_a_drag_of_one_pixel_turns_the_cameras_and_is_found():
    scene = dragged_scene(1.0)
    fit = refined(scene)
    true = total_rotation(scene.cameras.cam_from_world)
    bias = total_rotation(np.asarray(fit.cameras.cam_from_world)) - true
    displacement = found(fit)
    assert abs(np.rad2deg(bias)) > 0.3
    assert displacement.drag_px == pytest.approx(1.0, abs=0.12)
    assert displacement.drag_formal_px < 0.1


def test_without_it_the_cameras_are_those_of_the_truth():
    scene = dragged_scene(1.0)
    fit = refined(scene)
    height = np.full(len(scene.cameras), HEIGHT)
    observations = without_displacement(scene.observations, found(fit), fit, height)
    after = refined(type(scene)(scene.cameras, scene.points, scene.normals, observations))
    true = scene.cameras.cam_from_world

    def error(value):
        R = np.asarray(value.cameras.cam_from_world)
        Q = align_rotations(R, true)
        return float(np.sqrt(np.mean(rotation_angle(R @ Q @ true.transpose(0, 2, 1)) ** 2)))

    assert error(after) < 0.35 * error(fit)


def test_where_there_is_no_drag_none_is_found():
    displacement = found(refined(dragged_scene(0.0)))
    assert abs(displacement.drag_px) < 0.12


def test_at_a_small_rotation_the_prior_rules_and_the_uncertainty_says_so():
    displacement = found(refined(dragged_scene(1.0, num_images=4, range_deg=8.0)))
    assert abs(displacement.drag_px) < 0.1
    assert displacement.drag_sigma_px == pytest.approx(1.0, abs=0.1)


def test_a_prior_of_zero_seeks_none():
    displacement = found(refined(dragged_scene(1.0)), drag_sigma_px=0.0, drift_sigma_px=0.0)
    assert displacement.drag_px == 0.0
    assert not displacement.drift_px.any()


def test_the_depth_reversed_model_has_the_other_sign():
    displacement = found(refined(dragged_scene(1.0)))
    given = displacement.drag_figures(reverse=False).coefficient_px
    assert displacement.drag_figures(reverse=True).coefficient_px == -given


def test_the_normals_of_a_smooth_body_are_found_from_its_points():
    scene = dragged_scene(0.0, noise_px=0.0)
    normals = seen_normals(scene.points, scene.cameras, scene.observations)
    assert np.quantile(np.sum(normals * scene.normals, axis=1), 0.05) > 0.95


def test_the_field_is_along_the_slope_and_zero_where_the_surface_faces_the_viewer():
    R = np.eye(3)[None]
    normals = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.6, 0.8]])
    field = drag_field(R, normals, np.zeros(3, dtype=np.int64), np.arange(3))
    np.testing.assert_allclose(field, [[0.0, 0.0], [0.48, 0.0], [0.0, 0.0]], atol=1e-12)


def test_a_step_of_the_solver_moves_the_prediction_by_the_jacobian():
    scene = dragged_scene(0.0, num_points=200)
    M = len(scene.cameras)
    base = BundleModel.build(
        M, free_scale=True, free_affine=False, scale_sigma=0.001, affine_sigma=1.0
    )
    R = np.asarray(scene.cameras.cam_from_world)
    model = DragModel(base=base, cam_from_world=R, normals=scene.normals)
    obs = scene.observations
    params = (scene.cameras, 0.3)
    step = np.zeros(model.num_params)
    step[-1] = 1e-3

    def shown(p):
        return model.displacement(p, obs.image_idx, obs.track_idx)

    J = model.jacobian(params, scene.points, obs.image_idx, obs.track_idx)
    moved = (shown(model.retract(params, step)) - shown(params)) / 1e-3
    np.testing.assert_allclose(moved, J[:, :, -1], atol=1e-9)
    residual, derivative = model.prior(params)
    assert residual[-1] == pytest.approx(0.3)
    assert derivative[-1, model.num_params - 1] == pytest.approx(1.0)


def test_the_solver_finds_the_coefficient_together_with_the_cameras():
    scene = dragged_scene(0.8, noise_px=0.02)
    M = len(scene.cameras)
    base = BundleModel.build(
        M, free_scale=True, free_affine=False, scale_sigma=0.001, affine_sigma=1.0
    )
    R = np.asarray(scene.cameras.cam_from_world)
    model = DragModel(base=base, cam_from_world=R, normals=scene.normals)
    end = minimise(model, (scene.cameras, 0.0), scene.observations, sigma_px=0.02)
    assert end.converged
    assert end.params[1] == pytest.approx(0.8, abs=0.01)


def test_the_doubt_grows_with_the_coefficient_and_as_the_rotation_shrinks():
    assert doubt_px(1.0) > doubt_px(0.0) > 0.0
    assert misfit_px(115.0) < 0.1 < 1.0 == misfit_px(30.0) < misfit_px(10.0)
