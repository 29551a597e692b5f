from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine, registered_images
from semsfm_colmap.refinement.resection import resect
from semsfm_colmap.refinement.trust import covariance_of
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg


def refined(s, **options):
    """From slightly wrong cameras, as the factorization leaves them."""
    rng = np.random.default_rng(0)
    model = BundleModel.build(
        len(s.cameras), free_scale=False, free_affine=False, scale_sigma=1, affine_sigma=1
    )
    start = model.retract(s.cameras, 0.002 * rng.normal(size=model.num_params))
    return refine(
        start,
        np.arange(len(s.cameras)),
        s.observations,
        RefinementOptions(**options),
        rng=rng,
    )


def body(**options):
    defaults = {"num_images": 20, "range_deg": 100, "num_tracks": 3000, "track_window": 8}
    return simulate_tracks(**{**defaults, **options}, rng=np.random.default_rng(7))


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_wrong_matches_are_dropped_and_the_accuracy_stays(share):
    clean, dirty = refined(body()).value, refined(body(outlier_share=share)).value
    s = body(outlier_share=share)
    assert np.mean(dirty.inlier[~s.correct]) < 0.02
    assert np.mean(dirty.inlier[s.correct]) > 0.9
    truth = s.cameras.cam_from_world
    error = [
        np.median(best_hand_errors_deg(f.cameras.cam_from_world, truth)) for f in (clean, dirty)
    ]
    assert error[1] < 1.5 * error[0] + 0.01


def test_noise_is_estimated_from_both_sides():
    for noise in (0.2, 0.6):
        fit = refined(body(noise_px=noise)).value
        assert 0.96 * noise < fit.sigma_px < 1.04 * noise


def test_thresholds_fall_and_no_round_gains_what_the_one_before_had_lost():
    fit = refined(body(outlier_share=0.1)).value
    thresholds = [r.threshold_px for r in fit.rounds]
    assert thresholds == sorted(thresholds, reverse=True)
    assert fit.rounds[-1].num_observations <= fit.rounds[0].num_observations


@pytest.mark.parametrize(("noise", "lower", "upper"), [(0.1, 0.4, 0.45), (0.6, 2.4, 2.7)])
def test_the_last_round_keeps_three_standard_deviations_whatever_the_noise(noise, lower, upper):
    """3 sqrt(2) sigma: 0.42 px, where the paper stops at 1 px, and 2.55 px."""
    s = body(noise_px=noise, outlier_share=0.1)
    fit = refined(s).value
    assert lower < fit.rounds[-1].threshold_px < upper
    assert np.mean(fit.inlier[s.correct]) > 0.9


def test_the_last_adjustment_ends_at_the_minimum_of_plain_squares():
    """That is where COLMAP's bundle adjuster would go from there."""
    s = body(outlier_share=0.1)
    turns = {}
    for loss in ("squared", "cauchy"):
        fit = refined(s, last_loss=loss).value
        squares = bundle_adjust(
            fit.cameras, fit.observations, BundleSettings(sigma_px=fit.sigma_px)
        ).value.cameras
        change = best_hand_errors_deg(squares.cam_from_world, fit.cameras.cam_from_world)
        turns[loss] = np.max(change)
    assert turns["squared"] < 1e-3
    assert turns["cauchy"] > 5e-3


def test_an_image_of_something_else_is_left_out():
    s = body()
    xy = np.array(s.observations.xy)
    alien = s.observations.image_idx == 5
    xy[alien] = np.random.default_rng(1).uniform(0, 1000, (alien.sum(), 2))
    from dataclasses import replace

    fit = refined(replace(s, observations=replace(s.observations, xy=xy))).value
    assert fit.images.tolist() == [i for i in range(20) if i != 5]


def test_random_tracks_are_refused_with_a_reason():
    s = body(num_images=4, num_tracks=100, track_window=0, range_deg=20)
    from dataclasses import replace

    noise = np.random.default_rng(1).uniform(0, 1000, s.observations.xy.shape)
    failed = refined(replace(s, observations=replace(s.observations, xy=noise)))
    assert failed.value is None
    assert failed.status == "too_few_observations"


@pytest.mark.slow
def test_error_bars_of_the_rotations_are_true_from_both_sides():
    ratios = []
    for seed in range(12):
        s = simulate_tracks(
            num_images=8,
            range_deg=50,
            num_tracks=400,
            body="field",
            noise_px=0.3,
            scale_drift=0.001,
            rng=np.random.default_rng(seed),
        )
        fit = refined(s).value
        C = covariance_of(fit, np.full(8, 1000.0), Displacement.none(8))
        error = np.deg2rad(
            best_hand_errors_deg(fit.cameras.cam_from_world, s.cameras.cam_from_world)
        )
        ratios.append(np.sum(error**2) / np.sum(C.sigma_rotation_rad**2))
    assert 0.6 < np.mean(ratios) < 1.5


def test_resection_finds_the_camera_among_wrong_matches():
    s = body(num_images=5, body="field", track_window=0, num_tracks=200, noise_px=0.2)
    xy = np.array(s.observations.xy[s.observations.image_idx == 2])
    xy[::4] += 50.0
    found = resect(
        s.points, xy, threshold_px=2.0, min_inliers=12, rng=np.random.default_rng(0)
    ).value
    assert np.array_equal(found.inlier, np.arange(len(xy)) % 4 != 0)
    assert np.allclose(found.cam_from_world, s.cameras.cam_from_world[2], atol=2e-3)
    few = resect(
        s.points[:8], xy[:8], threshold_px=2.0, min_inliers=12, rng=np.random.default_rng(0)
    )
    assert few.status == "too_few_points"


def test_an_image_that_agrees_with_some_points_by_chance_is_left_out():
    """A fifth of an alien image's matches fit a view of the points, but not that of its place."""
    s = body()
    obs = s.observations
    rng = np.random.default_rng(2)
    xy = np.array(obs.xy)
    alien = np.flatnonzero(obs.image_idx == 9)
    xy[alien] = rng.uniform(0, 1000, (len(alien), 2))
    some = rng.permutation(alien)[: len(alien) // 5]
    xy[some] = s.cameras.project(s.points[obs.track_idx[some]], np.full(len(some), 12))
    changed = replace(s, observations=replace(obs, xy=xy))
    lenient = refined(changed, min_image_inlier_share=0.0).value
    fit = refined(changed).value
    assert 9 in lenient.images
    assert fit.images.tolist() == [i for i in range(20) if i != 9]


def test_a_share_of_inliers_is_counted_among_the_tracks_with_a_point():
    s = body(outlier_share=0.3)
    obs = s.observations
    kept = registered_images(s.correct, obs, RefinementOptions(), min_inlier_share=0.6)
    assert len(kept) == 20
    kept = registered_images(s.correct, obs, RefinementOptions(), min_inlier_share=0.8)
    assert len(kept) == 0
