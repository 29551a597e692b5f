"""Duplicates, noise model, predictions and growth of tracks, on data with known answers."""

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.matching.guided.distinct import distinct_points, distinct_tracks
from semsfm_colmap.matching.guided.grow import grow_tracks
from semsfm_colmap.matching.guided.noise import fit_relative_sigma
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.matching.guided.predict import References, frontal_references, predict
from semsfm_colmap.types import Observations, OrthographicCameras
from tests.matching.guided.test_align import texture
from tests.pickled import pickled_map

NUM_IMAGES, SIZE = 7, 260


def observations(image_idx, track_idx, xy, num_images, num_tracks):
    return Observations(
        image_idx=np.asarray(image_idx),
        track_idx=np.asarray(track_idx),
        keypoint_idx=np.zeros(len(image_idx), dtype=np.int64),
        xy=np.asarray(xy, dtype=float),
        num_images=num_images,
        num_tracks=num_tracks,
    )


def test_of_two_tracks_on_one_another_the_longer_stays():
    obs = observations(
        [0, 1, 2, 0, 1, 0, 1],
        [0, 0, 0, 1, 1, 2, 2],
        [[5, 5], [6, 5], [7, 5], [5.3, 5], [6.3, 5], [50, 50], [51, 50]],
        3,
        3,
    )
    assert distinct_tracks(obs, 1.0).tolist() == [True, False, True]
    assert distinct_tracks(obs, 0.1).tolist() == [True, True, True]


def test_tracks_that_cross_in_one_image_only_both_stay():
    obs = observations([0, 1, 0, 1], [0, 0, 1, 1], [[5, 5], [6, 5], [5, 5], [60, 5]], 2, 2)
    assert distinct_tracks(obs, 1.0).all()


def test_a_dropped_track_does_not_drop_others():
    """A chain a - b - c with a the longest: b goes, and c, which only b covers, stays."""
    xy = {0: (5.0, 5.0), 1: (5.8, 5.0), 2: (6.6, 5.0)}
    rows = [(i, t) for t, n in ((0, 4), (1, 3), (2, 2)) for i in range(n)]
    obs = observations([i for i, _ in rows], [t for _, t in rows], [xy[t] for _, t in rows], 4, 3)
    assert distinct_tracks(obs, 1.0).tolist() == [True, False, True]


def test_the_noise_model_is_recovered_from_residuals_with_outliers():
    rng = np.random.default_rng(0)
    n = 60_000
    s, sine = rng.uniform(0.05, 0.5, n), rng.uniform(0.0, 0.9, n)
    sigma = np.sqrt((1.7 * s) ** 2 + 0.1**2 + (0.3 * sine) ** 2)
    residuals = rng.normal(size=(n, 2)) * sigma[:, None]
    residuals[:3000] *= 15.0
    found = fit_relative_sigma(residuals, np.ones(n), s, sine)
    expected = sigma / np.median(sigma)
    inside = (expected > 0.55) & (expected < 4.5)
    assert np.abs(found / expected - 1.0)[inside].max() < 0.1


def test_too_few_residuals_leave_all_alike():
    assert (fit_relative_sigma(np.ones((10, 2)), np.ones(10), np.ones(10), np.ones(10)) == 1).all()


def cameras(angles_deg):
    R = rotation_from_vector(np.deg2rad(np.asarray(angles_deg))[:, None] * [0.0, 1.0, 0.0])
    n = len(angles_deg)
    return OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.ones(n),
        translation_px=np.full((n, 2), SIZE / 2.0),
    )


def test_the_most_frontal_view_is_the_reference():
    cams = cameras([-40.0, 5.0, 30.0])
    obs = observations([0, 1, 2], [0, 0, 0], [[1, 1], [2, 2], [3, 3]], 3, 1)
    references = frontal_references(cams, np.array([[0.0, 0.0, -1.0]]), obs)
    assert references.image_idx.tolist() == [1]
    np.testing.assert_array_equal(references.xy, [[2.0, 2.0]])


def test_points_on_the_far_side_off_the_frame_or_too_oblique_are_not_expected():
    cams = cameras([0.0, 50.0])
    points = np.array([[0.0, 0, 0], [0, 0, 0], [500.0, 0, 0], [0, 0, 0]])
    normals = np.array([[0.0, 0, -1], [0, 0, 1], [0, 0, -1], [0.8, 0, -0.6]])
    references = References(image_idx=np.zeros(4, dtype=np.int64), xy=np.zeros((4, 2)))
    where = predict(1, cams, points, normals, references, (SIZE, SIZE), GuidedOptions())
    facing = -normals @ cams.viewing_direction[1]
    assert where.track_idx.tolist() == [0] or facing[3] > np.cos(np.deg2rad(65.0))
    assert 1 not in where.track_idx
    assert 2 not in where.track_idx


@pytest.fixture(scope="module")
def field():
    """A rough textured field seen from seven sides, rendered by solving for the visible point."""
    cams = cameras(np.linspace(-18.0, 18.0, NUM_IMAGES))
    xs = np.arange(SIZE) + 0.5 - SIZE / 2.0
    images = []
    for R in cams.cam_from_world:
        c, s = R[0, 0], R[0, 2]
        u, v = np.meshgrid(xs, xs)
        x = u / c
        for _ in range(40):  # u = c x + s z(x, y)
            x = (u - s * height(x, v)) / c
        images.append(np.clip(128.0 + 1.2 * texture(x, v), 0, 255).astype(np.uint8))
    return cams, images


def height(x, y):
    return 8.0 * np.sin(x / 31.0) * np.cos(y / 27.0)


def start(cams, num_tracks=400, seed=0):
    """Tracks of three neighbouring images with matching noise."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-95.0, 95.0, size=(num_tracks, 2))
    points = np.column_stack([xy, height(*xy.T)])
    first = rng.integers(0, NUM_IMAGES - 2, num_tracks)
    image_idx = (first[:, None] + np.arange(3)).ravel()
    track_idx = np.repeat(np.arange(num_tracks), 3)
    seen = cams.project(points[track_idx], image_idx)
    noisy = seen + rng.normal(size=seen.shape) * 0.3
    return points, observations(image_idx, track_idx, noisy, NUM_IMAGES, num_tracks)


def test_tracks_grow_over_all_images_and_become_finer(field):
    cams, images = field
    _, obs = start(cams)
    grown = grow_tracks(cams, obs, lambda i: images[i], GuidedOptions())
    assert grown is not None
    found = grown.observations
    length = np.bincount(found.track_idx)
    assert length.mean() > 6.0
    assert found.num_tracks > 0.8 * obs.num_tracks
    # each track against the true surface point under its own reference view
    spread = []
    for j in range(found.num_tracks):
        rows = found.track_idx == j
        A = cams.projection[found.image_idx[rows]].reshape(-1, 3)
        b = (found.xy[rows] - cams.translation_px[found.image_idx[rows]]).ravel()
        X, *_ = np.linalg.lstsq(A, b, rcond=None)
        spread.append(np.abs(A @ X - b).mean())
    assert np.median(spread) < 0.06


def test_images_searched_in_other_processes_give_the_same_tracks(field):
    cams, images = field
    _, obs = start(cams)
    here, there = (
        grow_tracks(cams, obs, lambda i: images[i], GuidedOptions(), parallel_map=spread)
        for spread in (map, pickled_map)
    )
    np.testing.assert_array_equal(here.observations.xy, there.observations.xy)
    np.testing.assert_array_equal(here.sigma_px, there.sigma_px)


def test_without_extension_only_known_observations_are_aligned(field):
    cams, images = field
    _, obs = start(cams)
    grown = grow_tracks(cams, obs, lambda i: images[i], GuidedOptions(), extend=False)
    assert grown is not None
    assert np.bincount(grown.observations.track_idx).max() <= 3


def test_a_mask_keeps_observations_out(field):
    cams, images = field
    _, obs = start(cams)
    mask = np.ones((SIZE, SIZE), dtype=bool)
    mask[:, : SIZE // 2] = False
    grown = grow_tracks(
        cams, obs, lambda i: images[i], GuidedOptions(), read_mask=lambda i: mask if i else None
    )
    assert grown is not None
    o = grown.observations
    later = o.image_idx > 0
    # reference views were measured inside the masks of the matching, others are looked for
    outside = o.xy[later, 0] < SIZE // 2
    assert outside.mean() < 0.25


def test_too_few_tracks_give_nothing(field):
    cams, images = field
    _, obs = start(cams, num_tracks=20)
    assert grow_tracks(cams, obs, lambda i: images[i], GuidedOptions()) is None


def test_an_image_that_shows_something_else_gets_nothing(field):
    cams, images = field
    _, obs = start(cams)
    other = [*images[:-1], texture(*np.meshgrid(*[np.arange(SIZE)] * 2), seed=77).astype(np.uint8)]
    keep = obs.image_idx < NUM_IMAGES - 1
    obs = obs.select(keep)
    grown = grow_tracks(cams, obs, lambda i: other[i], GuidedOptions())
    assert grown is not None
    share = np.mean(grown.observations.image_idx == NUM_IMAGES - 1)
    assert share < 0.01


def test_of_points_that_are_one_spot_the_longest_track_stays():
    points = np.array([[0.0, 0, 0], [0.4, 0, 0], [5, 0, 0], [5, 0.3, 0], [5, 0, 0.3], [9, 0, 0]])
    length = np.array([3, 5, 4, 4, 9, 2])
    assert distinct_points(points, length, 0.5).tolist() == [False, True, False, False, True, True]
    assert distinct_points(points, length, 0.1).all()
    # a chain is thinned, not emptied
    chain = np.column_stack([0.9 * np.arange(5), np.zeros(5), np.zeros(5)])
    assert distinct_points(chain, np.full(5, 4), 1.0).tolist() == [True, False, True, False, True]


def test_turns_of_a_helix_do_not_multiply_the_points():
    rng = np.random.default_rng(0)
    spots = rng.uniform(0.0, 100.0, (400, 3))
    turns = np.concatenate([spots + rng.normal(0.0, 0.1, spots.shape) for _ in range(4)])
    keep = distinct_points(turns, rng.integers(3, 9, len(turns)), 0.8)
    assert 380 <= keep.sum() <= 410
