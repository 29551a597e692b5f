import numpy as np

from semsfm_colmap.geometry.subset import (
    keep_tracks,
    new_numbers,
    take_exactly,
    take_subset,
    thin_evenly,
)
from semsfm_colmap.synthetic.tracks import simulate_tracks


def scene():
    return simulate_tracks(
        num_images=12,
        range_deg=90,
        num_tracks=3000,
        track_window=5,
        rng=np.random.default_rng(0),
    ).observations


def test_thinned_tracks_leave_every_image_what_it_asks_for():
    obs = scene()
    # one image is poor: all its tracks must stay
    poor = (obs.image_idx == 4) & (obs.track_idx % 20 != 0)
    obs, _ = keep_tracks(obs, ~poor, min_length=2)
    before = np.bincount(obs.image_idx, minlength=12)
    keep = thin_evenly(obs, 150)
    thin = obs.select(keep[obs.track_idx])
    after = np.bincount(thin.image_idx, minlength=12)
    assert before[4] < 150
    assert after[4] == before[4]
    assert (after >= 0.8 * np.minimum(before, 150)).all()
    assert len(thin) < 0.5 * len(obs)


def test_few_tracks_are_not_thinned():
    obs = scene()
    assert thin_evenly(obs, 10**6).all()


def test_a_subset_holds_the_same_measurements_under_numbers_of_its_own():
    obs = scene()
    images = np.array([7, 2, 5, 6, 8])
    part = take_subset(obs, images=images, min_length=2)
    whole, own = obs.measurement_matrix(), part.observations.measurement_matrix()
    rows = (2 * images[:, None] + [0, 1]).ravel()
    np.testing.assert_array_equal(own, whole[np.ix_(rows, part.tracks)])
    assert np.isfinite(own).sum(axis=0).min() >= 4
    left_out = np.setdiff1d(np.arange(obs.num_tracks), part.tracks)
    assert np.isfinite(whole[np.ix_(rows, left_out)]).sum(axis=0).max() <= 2


def test_a_mask_of_a_subset_goes_back_to_the_whole():
    obs = scene()
    part = take_subset(obs, images=np.arange(3, 9), mask=obs.xy[:, 0] > 300.0, min_length=2)
    inside = part.observations.xy[:, 1] > 400.0
    back = part.in_whole(inside)
    np.testing.assert_array_equal(obs.xy[back], part.observations.xy[inside])
    assert not back[~part.rows].any()


def test_where_all_stay_the_observations_are_the_same():
    obs = scene()
    part = take_subset(obs)
    assert part.observations.xy is obs.xy
    assert part.rows.all()


def test_taken_exactly_short_tracks_stay():
    obs = scene()
    images, tracks = np.array([4, 5]), np.unique(obs.track_idx[obs.image_idx == 4])
    part = take_exactly(obs, images, tracks)
    assert part.observations.num_tracks == len(tracks)
    assert np.bincount(part.observations.track_idx).min() == 1
    np.testing.assert_array_equal(part.observations.xy, obs.xy[part.rows])


def test_new_numbers_are_the_places_of_the_old_ones():
    assert new_numbers(np.array([4, 0, 2]), 6).tolist() == [1, -1, 2, -1, 0, -1]
