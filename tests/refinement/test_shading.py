"""Fields of shading: told from turns where several series show a body turned in the image."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import MIRROR_Z, rotation_angle
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import plain_model
from semsfm_colmap.refinement.displaced import find_displacement, without_displacement
from semsfm_colmap.refinement.drag import DragModel, drag_field
from semsfm_colmap.refinement.shading import (
    NUM_FIELDS,
    SHADING_SIGMA_PX,
    ShadingModel,
    fields_of_series,
    reversed_coefficients,
    shading_fields,
)
from semsfm_colmap.refinement.trust import uncertainty_of
from tests.dragged import dragged_scene, refined

HEIGHT = 400.0
PULL = np.array([0.2, -0.2, 0.0, -0.3, 0.3, 0.2, 0.0, 0.2, 0.2])
"""Coefficients, px: a detector on one side, and what else comes with it."""


def pulled(R, normals, image, track):
    return shading_fields(R, normals, image, track) @ PULL


def between_deg(cameras, true):
    """Angle between the alignments of the two series."""
    R, S, series = cameras.cam_from_world, true.cam_from_world, true.series_idx
    first, second = (align_rotations(R[series == k], S[series == k]) for k in (0, 1))
    return float(np.rad2deg(rotation_angle(first @ second.T)))


def find(fit, **options):
    chosen = {"drift_sigma_px": 0.2, "drag_sigma_px": 1.0} | options
    settings = BundleSettings(sigma_px=fit.sigma_px, **chosen)
    return find_displacement(fit, np.full(len(fit.images), HEIGHT), settings)


@pytest.fixture(scope="module")
def scene():
    return dragged_scene(
        0.7, num_images=10, range_deg=70.0, mount_deg=90.0, num_points=2500, extra=pulled
    )


@pytest.fixture(scope="module")
def fit(scene):
    return refined(scene)


def test_what_turns_two_series_against_each_other_is_found_and_taken_out(scene, fit):
    found = find(fit)
    assert found.drag_px == pytest.approx(0.7, abs=0.15)
    # the first two are nearly a shift of the image, and suffer most from normals that are not exact
    np.testing.assert_allclose(found.shading_px[:2], PULL[:2], atol=0.15)
    np.testing.assert_allclose(found.shading_px[2:], PULL[2:], atol=0.05)
    height = np.full(len(scene.cameras), HEIGHT)
    observations = without_displacement(scene.observations, found, fit, height)
    after = refined(replace(scene, observations=observations))
    before_deg = between_deg(fit.cameras, scene.cameras)
    assert before_deg > 0.2
    assert between_deg(after.cameras, scene.cameras) < 0.5 * before_deg


def test_of_one_series_none_are_sought(scene):
    alone = dragged_scene(0.7, num_images=10, range_deg=70.0, extra=pulled)
    assert find(refined(alone)).shading_px is None
    with_label = replace(alone.cameras, series_idx=np.zeros(10, dtype=np.int64))
    assert find(refined(replace(alone, cameras=with_label))).shading_px is None


def test_nor_where_no_drag_is_sought(fit):
    found = find(fit, drag_sigma_px=0.0)
    assert found.shading_px is None
    assert found.drag_figures(reverse=False) is None


def test_where_shading_does_nothing_the_coefficients_are_noise():
    clean = dragged_scene(0.0, num_images=10, range_deg=70.0, mount_deg=90.0)
    assert np.abs(find(refined(clean)).shading_px).max() < 0.05


def test_the_derivative_is_that_of_the_displacement(scene):
    cameras, obs = scene.cameras, scene.observations
    R = np.asarray(cameras.cam_from_world)
    shading = ShadingModel(
        base=plain_model(len(cameras), 0.01), cam_from_world=R, normals=scene.normals
    )
    model = DragModel(base=shading, cam_from_world=R, normals=scene.normals, sigma=1.0)
    rows = np.arange(0, len(obs), 50)
    image, track = obs.image_idx[rows], obs.track_idx[rows]
    J = model.jacobian(((cameras, PULL), 0.3), scene.points, image, track)
    assert J.shape[2] == 6 + NUM_FIELDS + 1

    def shown(params):
        A, t = model.cameras(params)
        X = scene.points[track]
        return (
            np.einsum("oij,oj->oi", A[image], X)
            + t[image]
            + model.displacement(params, image, track)
        )

    at = ((cameras, PULL), 0.3)
    for index in range(model.num_params):
        step = np.zeros(model.num_params)
        step[index] = 1e-5
        slope = (shown(model.retract(at, step)) - shown(model.retract(at, -step))) / 2e-5
        stated = np.zeros_like(slope)
        for o, i in enumerate(image):
            for column in np.flatnonzero(model.param_idx[i] == index):
                stated[o] += J[o, :, column]
        np.testing.assert_allclose(stated, slope, atol=2e-6 * max(1.0, np.abs(slope).max()))


def test_the_prior_holds_the_coefficients_near_zero(scene):
    cameras = scene.cameras
    R = np.asarray(cameras.cam_from_world)
    model = ShadingModel(
        base=plain_model(len(cameras), 0.01), cam_from_world=R, normals=scene.normals
    )
    r, J = model.prior((cameras, PULL))
    np.testing.assert_allclose(r[-NUM_FIELDS:], PULL / SHADING_SIGMA_PX)
    assert J.shape == (len(r), model.num_params)
    dense = J.toarray()[-NUM_FIELDS:, -NUM_FIELDS:]
    np.testing.assert_allclose(dense, np.eye(NUM_FIELDS) / SHADING_SIGMA_PX)


def test_fields_of_each_series_are_those_of_all_where_the_image_is_of_it(scene):
    R, normals = np.asarray(scene.cameras.cam_from_world), scene.normals
    series, obs = scene.cameras.series_idx, scene.observations
    fields = fields_of_series(R, normals, obs.image_idx, obs.track_idx, series)
    assert fields.shape == (len(obs), 2, 20)
    for o in range(0, len(obs), 997):
        i, j = obs.image_idx[o : o + 1], obs.track_idx[o : o + 1]
        drag = drag_field(R, normals, i, j)[0]
        other = shading_fields(R, normals, i, j)[0]
        k = series[i[0]]
        for column in range(20):
            which, own = divmod(column, 10)
            expected = drag if own == 0 else other[:, own - 1]
            np.testing.assert_allclose(fields[o, :, column], expected * (which == k))


def test_the_depth_reversed_body_shows_the_same_with_its_own_coefficients(scene):
    """Normals of the depth-reversed body point to the viewer again: ``-D n``."""
    R, obs = np.asarray(scene.cameras.cam_from_world), scene.observations
    mirrored = MIRROR_Z @ R @ MIRROR_Z
    normals = -scene.normals @ MIRROR_Z
    there = shading_fields(mirrored, normals, obs.image_idx, obs.track_idx)
    np.testing.assert_allclose(
        there @ reversed_coefficients(PULL),
        pulled(R, scene.normals, obs.image_idx, obs.track_idx),
        atol=1e-12,
    )
    figures = find(refined(scene)).drag_figures(reverse=True)
    given = find(refined(scene)).drag_figures(reverse=False)
    assert figures.shading_px == tuple(reversed_coefficients(np.array(given.shading_px)))


def test_several_series_have_longer_error_bars_than_one_would_give_them(scene, fit):
    height = np.full(len(fit.images), HEIGHT)
    found = find(fit)
    several = uncertainty_of(fit, height, found)
    as_one = replace(fit, cameras=replace(fit.cameras, series_idx=None))
    one = uncertainty_of(as_one, height, replace(found, shading_px=None))
    assert np.mean(several.total.sigma_rotation_rad) > 1.2 * np.mean(one.total.sigma_rotation_rad)
