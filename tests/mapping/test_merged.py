"""Where each of several series stands in a model."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.mapping.merged import (
    MIN_SHARED_POINTS,
    in_plane_turn_deg,
    places_in,
    series_apart,
    series_notes,
    series_sigmas,
)
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.records import SeriesSigma
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.trust import uncertainty_of
from semsfm_colmap.refinement.uncertainty import apply_covariance
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Reconstruction
from tests.alignment import best_hand_errors_deg

SERIES = np.repeat([0, 1], 8)
NAMES = tuple(f"{'ab'[k]}_{i}.png" for i, k in enumerate(SERIES))


@pytest.fixture(scope="module")
def truth():
    """A body turned about y, then mounted a quarter turn on at 1.7 times the magnification."""
    rng = np.random.default_rng(5)
    s = simulate_tracks(
        num_images=16, range_deg=70, num_tracks=700, noise_px=0.0, wobble_deg=0.0, rng=rng
    )
    turns = s.cameras.cam_from_world[::2]
    quarter = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    cameras = replace(
        s.cameras,
        cam_from_world=np.concatenate([turns, turns @ quarter]),
        scale_px_per_unit=np.where(SERIES == 1, 1.7, 1.0),
    )
    obs = s.observations
    xy = cameras.project(s.points[obs.track_idx], obs.image_idx)
    return cameras, s.points, replace(obs, xy=xy + 0.2 * rng.normal(size=xy.shape))


@pytest.fixture
def model(truth):
    cameras, points, obs = truth
    return Reconstruction(
        image_names=NAMES,
        image_size_px=np.full((16, 2), 1000),
        cameras=cameras,
        points=points,
        observations=obs,
        inlier=np.ones(len(obs), dtype=bool),
    )


def places(model, sizes_um=(None, None)):
    return places_in(model, NAMES, SERIES, ("a", "b"), sizes_um)


def test_two_series_are_factorized_and_adjusted_to_one_model(truth):
    cameras, _, obs = truth
    end = map_observations(
        obs,
        NAMES,
        np.full((16, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
        pixel_size_um=0.01,
        series_idx=SERIES,
    )
    (part,) = end.value
    found = part.reconstruction.cameras
    errors = best_hand_errors_deg(found.cam_from_world, cameras.cam_from_world)
    assert errors.max() < 0.05
    log_scale = np.log(found.scale_px_per_unit)
    assert np.exp(log_scale[8:].mean() - log_scale[:8].mean()) == pytest.approx(1.7, rel=1e-3)
    # the pixel size is that of the first series
    assert np.exp(log_scale[:8].mean()) == pytest.approx(1.0 / 0.01, rel=1e-9)
    assert not any("magnification differs" in note for note in part.figures.notes)


def test_shared_points_ratio_and_axes_are_those_of_the_cameras(model, truth):
    _, _, obs = truth
    first, second = places(model)
    seen = [set(obs.track_idx[SERIES[obs.image_idx] == k].tolist()) for k in (0, 1)]
    assert first.num_shared == second.num_shared == len(seen[0] & seen[1])
    assert (first.num_images, first.num_given) == (8, 8)
    assert second.log_scale - first.log_scale == pytest.approx(np.log(1.7))
    assert first.range_deg == pytest.approx(np.ptp(np.linspace(-35, 35, 16)[::2]), abs=1e-6)
    assert series_apart([first, second]) is None
    note = series_notes([first, second])[1]
    assert "1.7000 times its magnification" in note
    assert second.in_plane_deg == pytest.approx(90.0, abs=0.1)
    assert first.in_plane_deg == pytest.approx(0.0, abs=1e-6)
    assert "turned by 90 deg in the image plane against a" in note
    assert len(series_notes([first, second])) == 2
    # axis (0.02, 1, 0.03): a quarter turn about z leaves 0.03^2 of its cosine
    assert "axis 89.9 deg from its axis" in note


@pytest.mark.parametrize("angle_deg", [-120.0, 0.0, 35.0])
def test_a_turn_in_the_image_plane_is_found_from_views_along_one_line(truth, angle_deg):
    R = truth[0].cam_from_world[:8]
    about_z = rotation_from_vector(np.array([0.0, 0.0, np.deg2rad(angle_deg)]))
    assert in_plane_turn_deg(R, about_z @ R[5:]) == pytest.approx(angle_deg, abs=1e-9)
    assert np.isnan(in_plane_turn_deg(R, R[:0]))


def test_how_well_a_series_lies_to_the_first_is_said(model):
    sigma = SeriesSigma(turn_deg=0.1234, scale=0.00217)
    note = series_notes(places(model), (sigma,))[1]
    assert "how it lies to a is known to 0.12 deg about each axis and 0.22 % of the" in note
    assert "is known" not in series_notes(places(model), (sigma,))[0]


def test_its_sigmas_are_those_of_the_angles_and_ratios_of_drawn_cameras(truth):
    cameras, _, obs = truth
    fit = refine(
        replace(cameras, scale_px_per_unit=cameras.scale_px_per_unit / np.sqrt(1.7)),
        np.arange(16),
        obs,
        RefinementOptions(),
        rng=np.random.default_rng(0),
        series_idx=SERIES,
    ).value
    uncertainty = uncertainty_of(fit, np.full(16, 1000.0), Displacement.none(16))
    (stated,) = series_sigmas(fit, uncertainty)
    n = len(uncertainty.noise.cameras.gauge)
    C = apply_covariance(uncertainty.noise.cameras, np.eye(n))
    C += sum(modes @ modes.T for modes in uncertainty.modes.values())
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(n), C, size=1500)
    model = fit.adjustment.model
    turns, ratios = [], []
    for draw in draws:
        drawn = model.retract(fit.cameras, draw[: model.num_params])
        first, second = (
            align_rotations(
                drawn.cam_from_world[k == SERIES], fit.cameras.cam_from_world[k == SERIES]
            )
            for k in (0, 1)
        )
        turns.append(rotation_angle(first @ second.T))
        log_scale = np.log(drawn.scale_px_per_unit / fit.cameras.scale_px_per_unit)
        ratios.append(log_scale[SERIES == 1].mean() - log_scale[SERIES == 0].mean())
    per_axis = np.rad2deg(np.sqrt(np.mean(np.square(turns)) / 3))
    assert stated.turn_deg == pytest.approx(per_axis, rel=0.08)
    assert stated.scale == pytest.approx(np.std(ratios), rel=0.08)
    alone = replace(fit, cameras=replace(fit.cameras, series_idx=None))
    assert series_sigmas(alone, uncertainty) is None
    assert series_sigmas(fit, None) is None


def test_a_ratio_that_the_pixel_sizes_contradict_is_said(model):
    assert "(1.6949 times by the pixel sizes)" in series_notes(places(model, (0.1, 0.059)))[1]
    assert "one of the two is wrong" in series_notes(places(model, (0.1, 0.05)))[1]
    assert "pixel sizes" not in series_notes(places(model, (0.1, None)))[1]


def test_a_series_without_images_in_the_model_is_refused(model):
    obs = model.observations
    kept = obs.select(obs.image_idx < 8)
    alone = replace(
        model,
        image_names=NAMES[:8],
        image_size_px=model.image_size_px[:8],
        cameras=model.cameras.select(np.arange(8)),
        observations=replace(kept, num_images=8),
        inlier=np.ones(len(kept), dtype=bool),
    )
    sentence = series_apart(places(alone))
    assert "b has nothing in common" in sentence
    assert "0 of its 8 images" in sentence


def test_a_series_that_hangs_on_a_few_points_is_refused(model):
    obs = model.observations
    series = SERIES[obs.image_idx]
    few = np.unique(obs.track_idx)[: MIN_SHARED_POINTS - 1]
    # every other point is left to one series alone
    inlier = np.isin(obs.track_idx, few) | (series == obs.track_idx % 2)
    sentence = series_apart(places(replace(model, inlier=inlier)))
    assert "by " in sentence
    assert "a guess" in sentence
