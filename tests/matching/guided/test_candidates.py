"""Keypoints without a track as further points: on planes and fields with known answers."""

import numpy as np
import pytest

from semsfm_colmap.matching.guided.candidates import (
    MIN_DISTANCE_PX,
    add_candidates,
    apart,
    interpolated,
)
from semsfm_colmap.matching.guided.grow import grow_tracks
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.matching.guided.predict import References, Seeds
from tests.matching.guided.test_tracks import (
    NUM_IMAGES,
    cameras,
    field,
    height,
    observations,
    start,
)

__all__ = ["field"]
NORMAL = np.array([0.2, -0.1, -1.0]) / np.linalg.norm([0.2, -0.1, -1.0])


def on_plane(xy, offset=0.0):
    """Points of the plane with `NORMAL` through the origin, moved along z."""
    z = -(xy @ NORMAL[:2]) / NORMAL[2] + offset
    return np.column_stack([xy, z])


def plane_seen_by(cams, points, normal=NORMAL):
    """Seeds and observations of points that all images see; the first one is the reference."""
    M, N = len(cams), len(points)
    image_idx, track_idx = np.tile(np.arange(M), N), np.repeat(np.arange(N), M)
    obs = observations(image_idx, track_idx, cams.project(points[track_idx], image_idx), M, N)
    seeds = Seeds(
        points=points,
        normals=np.tile(normal, (N, 1)),
        references=References(
            image_idx=np.zeros(N, dtype=np.int64), xy=cams.project(points, np.zeros(N, dtype=int))
        ),
    )
    return seeds, obs


@pytest.fixture
def plane():
    cams = cameras([0.0, 5.0, 10.0, 40.0])
    points = on_plane(np.random.default_rng(0).uniform(-60, 60, (200, 2)))
    return cams, *plane_seen_by(cams, points)


def add(plane, keypoints, **more):
    cams, seeds, obs = plane
    options = {"max_shift_px": 2.0, "max_num_points": 1000} | more
    rng = np.random.default_rng(0)
    return add_candidates(cams, seeds, obs, lambda i: keypoints[i], rng=rng, **options)


def test_on_a_plane_the_points_of_other_places_are_exact(plane):
    cams, seeds, obs = plane
    truth = on_plane(np.array([[3.0, -7.0], [20.0, 31.0]]))
    for i in range(len(cams)):
        rows = obs.image_idx == i
        xy = cams.project(truth, np.full(2, i))
        X, normal, spread = interpolated(cams, i, xy, obs.xy[rows], seeds.points, seeds.normals)
        np.testing.assert_allclose(X, truth, atol=1e-9)
        np.testing.assert_allclose(normal, np.tile(NORMAL, (2, 1)), atol=1e-9)
        assert spread.max() < 1e-9


def test_a_place_far_from_all_known_points_has_no_depth(plane):
    cams, seeds, obs = plane
    rows = obs.image_idx == 0
    far = np.array([[400.0, 400.0]])
    *_, spread = interpolated(cams, 0, far, obs.xy[rows], seeds.points, seeds.normals)
    assert np.isinf(spread).all()


def test_planes_seen_edge_on_are_not_asked(plane):
    cams, seeds, obs = plane
    rows = obs.image_idx == 0
    grazing = np.tile([1.0, 0.0, -0.05], (200, 1))
    *_, spread = interpolated(cams, 0, np.zeros((1, 2)), obs.xy[rows], seeds.points, grazing)
    assert np.isinf(spread).all()


def test_a_keypoint_becomes_a_candidate_once_and_not_where_a_point_is_known(plane):
    cams, seeds, _ = plane
    place = on_plane(np.array([[1.0, 2.0]]))
    while np.min(np.linalg.norm(seeds.points[:, :2] - place[0, :2], axis=1)) < 5.0:
        place = on_plane(place[:, :2] + 0.5)
    known = cams.project(seeds.points[:5], np.zeros(5, dtype=int)) + 0.5
    seen = [cams.project(place, np.array([i])) for i in range(4)]
    # twice in the first image, in every other image again
    keypoints = [np.concatenate([seen[0], seen[0] + 0.4, known]), *seen[1:]]
    more = add(plane, keypoints)
    assert len(more.points) == len(seeds.points) + 1
    np.testing.assert_allclose(more.points[-1], place[0], atol=1e-9)
    np.testing.assert_allclose(more.points[:-1], seeds.points)
    assert more.references.image_idx[-1] == 0
    np.testing.assert_allclose(more.references.xy[-1], seen[0][0])


def test_places_that_stay_are_those_of_asking_one_after_the_other():
    rng = np.random.default_rng(4)
    xy, taken = rng.uniform(0, 60, (300, 2)), rng.uniform(0, 60, (20, 2))
    kept = []
    for place in xy:
        near = np.concatenate([taken, np.reshape(kept, (-1, 2))])
        if np.min(np.linalg.norm(near - place, axis=1)) > MIN_DISTANCE_PX:
            kept.append(place)
    np.testing.assert_array_equal(apart(xy, taken), kept)
    # a row of three, each too near to the next: the last stays
    row = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
    np.testing.assert_array_equal(apart(row, np.zeros((0, 2))), row[[0, 2]])


def test_a_depth_too_uncertain_for_the_two_nearest_views_is_left_out(plane):
    cams, seeds, _ = plane
    rng = np.random.default_rng(1)
    rough = on_plane(seeds.points[:, :2], rng.normal(size=200) * 15.0)
    seeds, obs = plane_seen_by(cams, rough)
    keypoints = [rng.uniform(80, 180, (60, 2)), *[np.zeros((0, 2))] * 3]
    # 15 px of depth are 1.3 px of shift at 5 and 2.6 px at 10 degrees
    generous = add((cams, seeds, obs), keypoints, max_shift_px=20.0)
    strict = add((cams, seeds, obs), keypoints, max_shift_px=1.0)
    assert len(generous.points) - 200 > 30
    assert len(strict.points) - 200 < 0.3 * (len(generous.points) - 200)


def test_no_more_are_added_than_asked_for_and_as_many_from_each_image(plane):
    rng = np.random.default_rng(2)
    keypoints = [rng.uniform(80, 180, (60, 2)) for _ in range(4)]
    assert len(add(plane, keypoints, max_num_points=200).points) == 200
    assert len(add(plane, keypoints, max_num_points=0).points) == 200
    more = add(plane, keypoints, max_num_points=220)
    assert np.bincount(more.references.image_idx[200:]).tolist() == [5, 5, 5, 5]


def test_unmatched_keypoints_become_tracks_at_their_true_places(field):
    cams, images = field
    _, obs = start(cams, num_tracks=250)
    rng = np.random.default_rng(3)
    xy = rng.uniform(-90.0, 90.0, size=(300, 2))
    points = np.column_stack([xy, height(*xy.T)])
    keypoints = [
        cams.project(points[i::NUM_IMAGES], np.full(len(points[i::NUM_IMAGES]), i))
        for i in range(NUM_IMAGES)
    ]
    plain = grow_tracks(cams, obs, lambda i: images[i], GuidedOptions())
    more = grow_tracks(
        cams, obs, lambda i: images[i], GuidedOptions(), read_keypoints=lambda i: keypoints[i]
    )
    never = grow_tracks(
        cams,
        obs,
        lambda i: images[i],
        GuidedOptions(fill_up_to=0),
        read_keypoints=lambda i: keypoints[i],
    )
    assert len(never.observations) == len(plain.observations)
    added = more.observations.num_tracks - plain.observations.num_tracks
    assert added > 60
    # the new tracks are as true as the old ones: one point fits each
    A, b = cams.projection, cams.translation_px
    errors = []
    for track in range(more.observations.num_tracks):
        rows = more.observations.track_idx == track
        i, xy = more.observations.image_idx[rows], more.observations.xy[rows]
        X = np.linalg.lstsq(A[i].reshape(-1, 3), (xy - b[i]).ravel(), rcond=None)[0]
        errors.append(np.sqrt(np.mean((A[i] @ X + b[i] - xy) ** 2)))
    assert np.median(errors) < 0.1
    assert np.mean(np.array(errors) < 0.5) > 0.95
