"""Views taken twice: error bars shrink by what they add, not by how many they are."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.repeated_views import counted_once, repeated_notes, view_numbers
from semsfm_colmap.refinement.trust import covariance_of, noise_of_total_rotation, uncertainty_of
from tests.dragged import dragged_scene, refined

HEIGHT = 400.0


def taken(times, *, own_px, shared_px, seed=0, num_images=8):
    """A series with every view taken so often: errors shared by its frames, and their own."""
    scene = dragged_scene(0.0, num_images=num_images, num_points=700, noise_px=0.0, seed=seed)
    obs, cameras = scene.observations, scene.cameras
    rng = np.random.default_rng(seed + 100)
    shared = shared_px * rng.normal(size=(len(obs), 2))
    row = np.repeat(np.arange(len(obs)), times)
    frame = obs.image_idx[row] * times + np.tile(np.arange(times), len(obs))
    xy = obs.xy[row] + shared[row] + own_px * rng.normal(size=(len(row), 2))
    view = np.repeat(np.arange(num_images), times)
    scene = replace(
        scene,
        cameras=replace(
            cameras,
            cam_from_world=cameras.cam_from_world[view],
            scale_px_per_unit=cameras.scale_px_per_unit[view],
            translation_px=cameras.translation_px[view],
        ),
        observations=replace(
            obs, image_idx=frame, track_idx=obs.track_idx[row], xy=xy,
            keypoint_idx=np.arange(len(row)), num_images=num_images * times,
        ),
    )  # fmt: skip
    return refined(scene)


def bars(value):
    """Formal sigma of the total rotation, and the median one of a point, px."""
    M = len(value.images)
    found = covariance_of(value, np.full(M, HEIGHT), Displacement.none(M))
    points = np.sqrt(np.einsum("nii->n", found.points))
    return noise_of_total_rotation(value, found), float(np.median(points))


@pytest.mark.parametrize("shares", [(0.02, 0.2), (0.15, 0.15), (0.2, 0.0)])
def test_a_series_taken_twice_is_as_certain_as_what_it_adds(shares):
    own, shared = shares
    # the mean of two frames has errors of this size; once each is what would be as certain
    same = bars(taken(1, own_px=0.0, shared_px=np.hypot(shared, own / np.sqrt(2))))
    twice = bars(taken(2, own_px=own, shared_px=shared))
    assert twice[1] == pytest.approx(same[1], rel=0.12)
    # the turn of a single frame has that frame's noise
    assert 0.95 < twice[0] / same[0] < 1.1 * np.sqrt(2)


def test_errors_that_frames_share_are_not_averaged_however_often():
    once = bars(taken(1, own_px=0.02, shared_px=0.2))
    thrice = bars(taken(3, own_px=0.02, shared_px=0.2))
    assert thrice[1] == pytest.approx(once[1], rel=0.12)
    assert thrice[0] > 0.95 * once[0]


def test_what_is_measured_is_the_share_that_was_put_in():
    found = counted_once(taken(2, own_px=0.1, shared_px=0.2))
    assert found.correlation == pytest.approx(0.8, abs=0.05)
    assert found.sigma_px == pytest.approx(np.hypot(0.1, 0.2), rel=0.05)
    assert found.num_images == 16
    assert "16 images show a view" in repeated_notes(found)[0]


def test_total_errors_of_points_hold_over_draws():
    pulls = []
    for seed in range(4):
        value = taken(2, own_px=0.03, shared_px=0.2, seed=seed)
        truth = dragged_scene(0.0, num_images=8, num_points=700, noise_px=0.0, seed=seed)
        M = len(value.images)
        found = covariance_of(value, np.full(M, HEIGHT), Displacement.none(M))
        d = value.points - truth.points[value.tracks]
        # the world of the fit is not that of the truth: an affinity of it says all that is common
        basis = np.column_stack([truth.points[value.tracks], np.ones(len(d))])
        d = d - basis @ np.linalg.lstsq(basis, d, rcond=None)[0]
        sigma = np.sqrt(np.einsum("nii->ni", found.points))
        pulls.append(d / sigma)
    assert np.sqrt(np.mean(np.concatenate(pulls) ** 2)) == pytest.approx(1.0, abs=0.12)


def test_a_series_of_views_taken_once_keeps_its_observations():
    value = refined(dragged_scene(0.0))
    found = counted_once(value)
    assert found.observations is value.observations
    assert found.sigma_px == value.sigma_px
    assert repeated_notes(found) == []


def test_the_bars_in_full_say_that_views_are_repeated():
    value = taken(2, own_px=0.03, shared_px=0.2)
    M = len(value.images)
    found = uncertainty_of(value, np.full(M, HEIGHT), Displacement.none(M))
    assert "another angle would tell more" in found.notes[0]


def test_views_are_no_chains():
    turns = np.deg2rad(np.arange(0.0, 3.0, 0.2))[:, None] * np.array([0.0, 1.0, 0.0])
    R = rotation_from_vector(turns)
    view = view_numbers(R, max_deg=0.5)
    for number in range(view.max() + 1):
        angles = np.rad2deg(turns[view == number, 1])
        assert np.ptp(angles) <= 0.5 + 1e-9
    assert view.max() >= 5
