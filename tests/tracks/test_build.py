import numpy as np

from semsfm_colmap.tracks.build import build_tracks, canonical_keypoints


def keypoints(num_images: int, num: int):
    return [np.random.default_rng(i).uniform(0, 100, (num, 2)) for i in range(num_images)]


def chain(num_images: int, num: int):
    rows = np.column_stack([np.arange(num), np.arange(num)])
    return {(i, i + 1): rows for i in range(num_images - 1)}


def test_a_chain_of_matches_becomes_one_track_per_point():
    kp = keypoints(5, 20)
    obs, counts = build_tracks(kp, chain(5, 20))
    assert (obs.num_tracks, len(obs), counts["num_refused"]) == (20, 100, 0)
    assert np.array_equal(obs.track_idx, np.repeat(np.arange(20), 5))
    assert np.array_equal(
        obs.xy, np.array([kp[i][k] for i, k in zip(obs.image_idx, obs.keypoint_idx, strict=True)])
    )


def test_a_match_that_would_see_an_image_twice_is_refused_when_it_is_the_worse_one():
    kp = keypoints(3, 2)
    matches = {
        (0, 1): np.array([[0, 0], [1, 1]]),
        (1, 2): np.array([[0, 0], [1, 1]]),
        (0, 2): np.array([[0, 1]]),
    }
    residuals = {
        (0, 1): np.array([0.1, 0.1]),
        (1, 2): np.array([0.1, 0.1]),
        (0, 2): np.array([1.5]),
    }
    obs, counts = build_tracks(kp, matches, residuals)
    assert counts["num_refused"] == 1
    assert obs.num_tracks == 2
    for j in range(2):
        assert len(np.unique(obs.image_idx[obs.track_idx == j])) == 3


def test_no_track_ever_sees_an_image_twice():
    rng = np.random.default_rng(0)
    kp = keypoints(8, 30)
    matches = {
        (i, j): np.column_stack([rng.permutation(30), rng.permutation(30)])[:12]
        for i in range(8)
        for j in range(i + 1, 8)
    }
    obs, _ = build_tracks(kp, matches)
    pairs = np.column_stack([obs.track_idx, obs.image_idx])
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert np.bincount(obs.track_idx).min() >= 2
    order = np.lexsort((obs.image_idx, obs.track_idx))
    assert np.array_equal(order, np.arange(len(obs)))


def test_keypoints_at_one_place_are_one():
    xy = np.array([[1.0, 1.0], [5.0, 5.0], [1.0, 1.0], [1.0, 1.2]])
    assert canonical_keypoints(xy).tolist() == [0, 1, 0, 3]
    obs, _ = build_tracks([xy, xy], {(0, 1): np.array([[0, 2], [2, 0], [1, 1]])})
    assert obs.num_tracks == 2


def test_nothing_matched_gives_no_tracks():
    obs, counts = build_tracks(keypoints(3, 5), {})
    assert (len(obs), obs.num_tracks, counts["num_matches"]) == (0, 0, 0)
