from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.tracks.split import split_tracks


def scene(noise_px=0.2):
    return simulate_tracks(
        num_images=12,
        range_deg=60,
        num_tracks=80,
        body="field",
        noise_px=noise_px,
        rng=np.random.default_rng(0),
    )


def fused(s, cut=6):
    """Each even track until image `cut`, the next odd one from there on, as one track."""
    obs = s.observations
    keep = (obs.track_idx % 2 == 0) == (obs.image_idx < cut)
    some = obs.select(keep)
    return replace(some, track_idx=some.track_idx // 2, num_tracks=obs.num_tracks // 2), (
        obs.track_idx[keep]
    )


def split(s, obs, images=None):
    images = np.arange(12) if images is None else images
    return split_tracks(obs, s.cameras.select(images), images, min_length=3, trials=15)


def test_tracks_of_two_points_are_cut_into_one_of_each():
    s = scene()
    obs, shown = fused(s)
    cut = split(s, obs)
    assert cut.num_tracks == 2 * obs.num_tracks
    assert len(cut) == len(obs)
    assert np.all(np.diff(cut.track_idx * 12 + cut.image_idx) > 0)
    # the same keypoints, each track of one point
    point = dict(zip(obs.keypoint_idx, shown, strict=True))
    shown_now = np.array([point[k] for k in cut.keypoint_idx])
    for j in range(cut.num_tracks):
        assert len(set(shown_now[cut.track_idx == j])) == 1
    where = dict(zip(obs.keypoint_idx, obs.xy.tolist(), strict=True))
    assert all(where[k] == xy for k, xy in zip(cut.keypoint_idx, cut.xy.tolist(), strict=True))


def test_good_tracks_stay_as_they_are():
    s = scene()
    assert split(s, s.observations) is s.observations


def test_single_wrong_observations_make_no_tracks():
    s = scene()
    obs = s.observations
    wrong = np.random.default_rng(1).random(len(obs)) < 0.1
    xy = np.where(wrong[:, None], np.random.default_rng(2).uniform(100, 900, obs.xy.shape), obs.xy)
    cut = split(s, replace(obs, xy=xy))
    # by chance three wrong ones may agree on a point
    assert cut.num_tracks - obs.num_tracks <= 2


def test_the_relative_noise_goes_with_its_observation():
    s = scene()
    obs, _ = fused(s)
    sigma = 1.0 + np.arange(len(obs))
    cut = split(s, replace(obs, relative_sigma=sigma))
    of = dict(zip(obs.keypoint_idx, sigma, strict=True))
    assert np.array_equal(cut.relative_sigma, [of[k] for k in cut.keypoint_idx])


@pytest.mark.parametrize("images", [[0, 1, 2, 6, 7, 8], [0, 1, 2, 3, 6, 7]])
def test_only_the_images_given_are_looked_at(images):
    s = scene()
    obs, _ = fused(s)
    cut = split(s, obs, np.array(images))
    inside = np.isin(cut.image_idx, images)
    assert np.all(cut.track_idx[~inside] < obs.num_tracks)
    # three observations are needed for a point of one's own
    new = np.sum(np.array(images) >= 6) >= 3
    assert cut.num_tracks == (2 if new else 1) * obs.num_tracks
