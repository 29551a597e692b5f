"""Perspective as a camera model: found with its sign, not where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.perspective import (
    PerspectiveModel,
    find_principal_point,
    fit_perspective,
    plain_model,
    without_perspective,
)
from semsfm_colmap.refinement.perspective_choice import choose_perspective, kappa_sigma
from semsfm_colmap.synthetic.tracks import seen_in_perspective, simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.oracles.geometry import numeric_jacobian

RADIUS, SIZE = 400.0, 1000.0
SETTINGS = BundleSettings(sigma_px=0.3)


def scene(
    kappa, *, num_images=16, range_deg=90.0, num_tracks=800, seed=5, centre=(0, 0, 0), **more
):
    """Tracks as a pinhole camera with focal length 1 / kappa sees them; the noise is the same."""
    s = simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=num_tracks,
        radius_px=RADIUS,
        rng=np.random.default_rng(seed),
        **more,
    )
    return seen_in_perspective(s, kappa, SIZE / 2, centre)


def looking(kappa, num_images):
    return Perspective(
        kappa=kappa,
        centre=np.zeros(3),
        principal_px=np.full((num_images, 2), SIZE / 2),
    )


def parallel(s):
    fit = bundle_adjust(s.cameras, s.observations, replace(SETTINGS, scale_sigma=0.02)).value
    return fit.cameras, fit.points


def fitted(s):
    M = len(s.cameras)
    return fit_perspective(*parallel(s), s.observations, np.full((M, 2), SIZE / 2), SETTINGS)


def error_deg(cameras, s):
    e = best_hand_errors_deg(cameras.cam_from_world, s.cameras.cam_from_world)
    return float(np.sqrt(np.mean(e**2)))


def test_a_pinhole_camera_is_what_it_describes():
    s = scene(0.0, num_images=5, num_tracks=50, noise_px=0.0)
    i, X = s.observations.image_idx, s.points[s.observations.track_idx]
    f, view = 5000.0, looking(1 / 5000.0, 5)
    y = np.einsum("oij,oj->oi", s.cameras.cam_from_world[i], X)
    # the camera stands f px (in units of the image) before the middle, t off its axis
    from_axis = np.asarray(s.cameras.translation_px)[i] - SIZE / 2
    scale = np.asarray(s.cameras.scale_px_per_unit)[i, None]
    pinhole = SIZE / 2 + f * (scale * y[:, :2] + from_axis) / (f + scale * y[:, 2:])
    q, z = s.cameras.project(X, i), view.depth(s.cameras, X, i)
    np.testing.assert_allclose(view.seen(q, z, i), pinhole, atol=1e-9)
    np.testing.assert_allclose(view.parallel(pinhole, z, i), q, atol=1e-9)


def test_derivatives_agree_with_finite_differences():
    s = scene(1e-4, num_images=4, num_tracks=40)
    obs = s.observations
    model = PerspectiveModel.build(
        plain_model(4, 0.01), s.cameras, s.points, np.full((4, 2), SIZE / 2)
    )

    def displaced(kappa):
        return model.displacement((s.cameras, kappa[0]), obs.image_idx, obs.track_idx)

    kappa = np.array([2e-4])
    h = 1e-8
    numeric = (displaced(kappa + h) - displaced(kappa - h)) / (2 * h)
    J = model.jacobian((s.cameras, kappa[0]), s.points, obs.image_idx, obs.track_idx)
    np.testing.assert_allclose(J[:, :, -1], numeric, rtol=1e-4, atol=1e-2)
    # and of the place by the point
    view, X = looking(2e-4, 4), s.points[obs.track_idx[:20]]
    i = obs.image_idx[:20]

    def place(step):
        moved = X + step
        return view.seen(s.cameras.project(moved, i), view.depth(s.cameras, moved, i), i)

    numeric = numeric_jacobian(place, np.zeros(3))
    np.testing.assert_allclose(view.local_affine(s.cameras, X, i), numeric, atol=1e-6)
    numeric = numeric_jacobian(
        lambda step: model.prior(model.retract((s.cameras, 1e-4), step))[0],
        np.zeros(model.num_params),
    )
    own = model.prior((s.cameras, 1e-4))[1].toarray()
    np.testing.assert_allclose(own, numeric, rtol=1e-4, atol=1e-4 * np.abs(numeric).max())


@pytest.mark.parametrize("per_radius", [0.08, 0.02, -0.08])
def test_kappa_is_found_with_its_sign_and_within_its_error_bar(per_radius):
    pulls = []
    for seed in range(3):
        s = scene(per_radius / RADIUS, seed=seed)
        fit = fitted(s)
        sigma = kappa_sigma(fit, s.observations, SETTINGS.sigma_px)
        assert sigma < 0.02 * abs(fit.kappa)
        pulls.append((fit.kappa - per_radius / RADIUS) / sigma)
        assert error_deg(fit.cameras, s) < 0.05 < error_deg(parallel(s)[0], s)
    assert np.sqrt(np.mean(np.square(pulls))) < 2.0


def test_poses_on_a_turntable_are_right_also_off_its_axis():
    s = scene(
        0.08 / RADIUS, num_images=24, range_deg=345.0, num_tracks=900, track_window=8,
        centre=(60.0, 0.0, 30.0),
    )  # fmt: skip
    fit = fitted(s)
    assert error_deg(parallel(s)[0], s) > 1.0
    assert error_deg(fit.cameras, s) < 0.1
    assert np.sqrt(np.mean(fit.residuals(s.observations) ** 2)) < 0.3


def test_without_perspective_the_observations_are_those_of_parallel_projection():
    s = scene(2e-4)
    ideal = scene(0.0)
    straight = without_perspective(s.observations, s.cameras, s.points, looking(2e-4, 16))
    # noise is magnified by as much as a point is nearer or farther
    assert np.abs(straight.xy - ideal.observations.xy).max() < 0.2 * 1.5
    assert np.abs(s.observations.xy - ideal.observations.xy).max() > 10.0
    nowhere = without_perspective(
        s.observations, s.cameras, np.full_like(s.points, np.nan), looking(2e-4, 16)
    )
    np.testing.assert_allclose(nowhere.xy, s.observations.xy)


@pytest.mark.parametrize(
    ("per_radius", "body", "found"),
    [(0.0, "body", False), (0.0, "field", False), (0.08, "body", True), (-0.02, "field", True)],
)
def test_the_rung_wins_where_there_is_perspective(per_radius, body, found):
    s = scene(per_radius / RADIUS, body=body)
    choice = choose_perspective(
        s.cameras, s.observations, np.full((16, 2), SIZE / 2), replace(SETTINGS, sigma_px=0.3)
    )
    assert choice.found is found
    assert choice.clear is found
    if found:
        assert choice.kappa == pytest.approx(per_radius / RADIUS, rel=0.05)
        figures = choice.figures(used=False)
        assert figures.distance_px * figures.kappa_per_px == pytest.approx(1.0)


def test_a_drag_is_not_taken_for_perspective():
    s = scene(0.0)
    obs = s.observations
    normal = s.points / np.linalg.norm(s.points, axis=1, keepdims=True)
    n = np.einsum("oij,oj->oi", s.cameras.cam_from_world[obs.image_idx], normal[obs.track_idx])
    dragged = replace(s, observations=replace(obs, xy=obs.xy - 0.8 * n[:, 2:] * n[:, :2]))
    choice = choose_perspective(
        s.cameras, dragged.observations, np.full((16, 2), SIZE / 2), SETTINGS
    )
    assert not choice.clear


def test_three_images_and_few_points_are_no_ground_for_a_choice():
    s = scene(2e-4, num_images=3, num_tracks=60)
    few = np.full((3, 2), SIZE / 2)
    assert choose_perspective(s.cameras, s.observations, few, SETTINGS) is None


def test_the_principal_point_is_found_where_there_is_much_perspective():
    offset, prior = np.array([12.0, -8.0]), 20.0
    s = scene(0.2 / RADIUS, num_images=8, range_deg=80.0, num_tracks=400, noise_px=0.1)
    settings = replace(SETTINGS, sigma_px=0.1)
    guess = np.full((8, 2), SIZE / 2) - offset
    start = fit_perspective(*parallel(s), s.observations, guess, settings)
    found = find_principal_point(start, s.observations, guess, settings, prior)
    assert found.sigma_px < 0.5 * prior
    assert np.linalg.norm(found.offset_px - offset) < 3.0 * found.sigma_px
    assert found.fit.adjustment.state.cost < start.adjustment.state.cost


def test_the_principal_point_stays_where_there_is_little():
    s = scene(0.01 / RADIUS, num_images=8, num_tracks=300)
    guess = np.full((8, 2), SIZE / 2)
    start = fit_perspective(*parallel(s), s.observations, guess, SETTINGS)
    found = find_principal_point(start, s.observations, guess, SETTINGS, 20.0)
    assert not found.offset_px.any()
    assert found.sigma_px == 20.0
