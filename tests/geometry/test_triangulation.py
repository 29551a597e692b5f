import numpy as np

from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.triangulation import triangulate_tracks, triangulation_angle
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.oracles.geometry import best_support


def _scene(outlier_share: float, seed: int = 0):
    s = simulate_tracks(
        num_images=6,
        range_deg=50,
        num_tracks=300,
        body="field",
        outlier_share=outlier_share,
        rng=np.random.default_rng(seed),
    )
    pointer = track_pointer(s.observations.track_idx, s.observations.num_tracks)
    return s, pointer


def _triangulate(s, pointer, **options):
    obs = s.observations
    return triangulate_tracks(
        s.cameras.projection,
        s.cameras.translation_px,
        obs.image_idx,
        pointer,
        obs.xy,
        **{"threshold_px": 2.0, "trials": 15, **options},
    )


def test_wrong_observations_are_marked_and_do_not_move_the_point():
    s, pointer = _scene(0.15)
    X, inlier = _triangulate(s, pointer)
    # where at most two of six observations are wrong, four agree and the truth must win
    wrong = np.bincount(s.observations.track_idx, weights=~s.correct)
    sure = wrong <= 2
    rows = sure[s.observations.track_idx]
    assert np.mean(inlier[rows] == s.correct[rows]) > 0.97
    error = np.linalg.norm(X - s.points, axis=1)[sure]
    assert np.median(error) < 1.0
    assert np.mean(error < 5.0) > 0.98


def test_support_is_never_much_smaller_than_the_best_of_all_pairs():
    s, pointer = _scene(0.3)
    _, inlier = _triangulate(s, pointer)
    obs = s.observations
    for j in range(60):
        o = slice(pointer[j], pointer[j + 1])
        i = obs.image_idx[o]
        best = best_support(s.cameras.projection[i], s.cameras.translation_px[i], obs.xy[o], 2.0)
        assert inlier[o].sum() >= best - 1


def test_same_seed_same_result_and_no_point_from_one_view():
    s, pointer = _scene(0.3)
    first, second = _triangulate(s, pointer, trials=3), _triangulate(s, pointer, trials=3)
    assert np.array_equal(first[0], second[0], equal_nan=True)
    assert np.array_equal(first[1], second[1])
    obs = s.observations.select(s.observations.image_idx == 0)
    X, inlier = triangulate_tracks(
        s.cameras.projection,
        s.cameras.translation_px,
        obs.image_idx,
        track_pointer(obs.track_idx, obs.num_tracks),
        obs.xy,
        threshold_px=2.0,
        trials=5,
    )
    assert np.isnan(X).all()
    assert not inlier.any()


def test_triangulation_angle_is_the_range_of_the_views():
    s, pointer = _scene(0.0)
    obs = s.observations
    direction = s.cameras.viewing_direction
    angle = triangulation_angle(direction, obs.image_idx, pointer, np.ones(len(obs), dtype=bool))
    expected = np.arccos(np.min(direction @ direction.T))
    assert np.allclose(angle, expected)
