import numpy as np

from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.triangulation import (
    drop_deviating,
    triangulate_tracks,
    triangulation_angle,
)
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


def deviations(P, t, xy):
    """Squared studentised residuals by leaving each observation out, (n,)."""
    out = np.empty(len(xy))
    for o in range(len(xy)):
        rest = np.arange(len(xy)) != o
        H = np.einsum("ndi,ndj->ij", P[rest], P[rest])
        X = np.linalg.solve(H, np.einsum("ndi,nd->i", P[rest], xy[rest] - t[rest]))
        r = P[o] @ X + t[o] - xy[o]
        # the prediction's own variance comes on top of the observation's
        out[o] = r @ np.linalg.solve(np.eye(2) + P[o] @ np.linalg.inv(H) @ P[o].T, r)
    return out


def test_an_observation_that_pulls_its_point_is_judged_by_the_others():
    """Against deletion: a residual divided by its covariance is what leaving it out predicts."""
    rng = np.random.default_rng(3)
    angles = np.deg2rad([-4.0, -2.0, 0.0, 2.0, 4.0, 30.0])
    P = rotation_from_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))[:, :2]
    t = np.zeros((6, 2))
    dropped = 0
    for _ in range(50):
        xy = P @ rng.normal(size=3) + 0.3 * rng.normal(size=(6, 2))
        xy[5, 0] += rng.uniform(-8.0, 8.0)
        q = deviations(P, t, xy)
        kept = drop_deviating(
            P, t, np.arange(6), np.array([0, 6]), xy, np.ones(6, dtype=bool),
            threshold_px=1.3, min_length=6,
        )  # fmt: skip
        # of six at least are needed, so that one is dropped at most: the worst
        expected = np.ones(6, dtype=bool)
        if q.max() > 1.3**2:
            expected[np.argmax(q)] = False
        dropped += not expected.all()
        close = np.abs(np.sort(q)[-1] - np.sort(q)[-2]) < 0.1 or abs(q.max() - 1.69) < 0.05
        assert close or np.array_equal(kept, expected)
    assert dropped > 10


def test_noise_alone_hardly_loses_an_observation():
    s = simulate_tracks(
        num_images=20, range_deg=60, num_tracks=3000, track_window=6, rng=np.random.default_rng(4)
    )
    obs = s.observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    kept = drop_deviating(
        s.cameras.projection, s.cameras.translation_px, obs.image_idx, pointer, obs.xy,
        np.ones(len(obs), dtype=bool), threshold_px=3.0 * np.sqrt(2.0) * 0.3, min_length=3,
    )  # fmt: skip
    # a chi square of two degrees of freedom exceeds 18 with a chance of 1.2e-4
    assert np.mean(~kept) < 5e-4
