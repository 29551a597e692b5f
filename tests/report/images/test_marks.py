import base64

import numpy as np
import pytest

from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.images.epipolar_lines import hyperplane_of_matches, packed_pair
from semsfm_colmap.report.images.marks import (
    even_by_fate,
    packed_trajectories,
    residual_vectors,
)
from semsfm_colmap.report.images.packed import (
    FULL,
    SCALE_STEP,
    SMALLEST_PX,
    packed_ellipses,
    packed_places,
    packed_residuals,
)
from tests.report.images.evidence import make_evidence, numbered
from tests.report.series import SIZE_PX, make_inputs, make_reconstruction


def unpack(text, dtype):
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


@pytest.fixture(scope="module")
def rec():
    return numbered(make_reconstruction(np.arange(5) * 6.0, window=2))


def test_places_come_back_within_a_hundredth_of_a_pixel():
    xy = np.random.default_rng(0).uniform(0.0, SIZE_PX, (200, 2))
    back = unpack(packed_places(xy, SIZE_PX), "<u2").reshape(-1, 2) / FULL * SIZE_PX
    assert 0.0 < np.abs(back - xy).max() < 0.01


def test_ellipses_come_back_with_their_axes_and_orientation():
    rng = np.random.default_rng(1)
    shape = rng.normal(size=(100, 2, 2)) * rng.uniform(1.0, 20.0, (100, 1, 1))
    rows = unpack(packed_ellipses(shape), "u1").reshape(-1, 4).astype(float)
    U, S, _ = np.linalg.svd(shape)
    longer = SMALLEST_PX * SCALE_STEP ** (rows[:, 0] - 1.0)
    np.testing.assert_allclose(longer, S[:, 0], rtol=0.016)
    np.testing.assert_allclose(rows[:, 1] / 255.0, S[:, 1] / S[:, 0], atol=0.003)
    axis = rows[:, 2] * np.pi / 256.0
    along = np.abs(np.cos(axis) * U[:, 0, 0] + np.sin(axis) * U[:, 1, 0])
    assert along.min() > np.cos(np.pi / 256.0)
    turn = rows[:, 3] * np.pi / 128.0
    first = shape[:, :, 0] / np.linalg.norm(shape[:, :, 0], axis=1, keepdims=True)
    assert (np.cos(turn) * first[:, 0] + np.sin(turn) * first[:, 1]).min() > np.cos(np.pi / 128)
    assert unpack(packed_ellipses(np.zeros((1, 2, 2))), "u1")[0] == 0


def test_residual_vectors_are_predicted_minus_measured(rec):
    vectors = residual_vectors(rec, rec.residuals(), 2, 10_000)
    rows = np.flatnonzero(rec.observations.image_idx == 2)
    assert vectors.total == len(vectors.xy) == len(rows)
    points = rec.points[rec.observations.track_idx[rows]]
    predicted = rec.cameras.project(points, np.full(len(rows), 2))
    np.testing.assert_allclose(vectors.xy + vectors.residual, predicted, atol=1e-9)
    back = unpack(packed_residuals(vectors.residual), "<i2").reshape(-1, 2) * 0.001
    assert np.abs(back - vectors.residual).max() <= 0.0005 + 1e-9


def test_thinned_residual_vectors_say_how_many_there_are(rec):
    vectors = residual_vectors(rec, rec.residuals(), 0, 7)
    assert len(vectors.xy) == 7
    assert vectors.total > 100


def test_thinning_leaves_each_fate_its_share():
    fate = np.repeat([0, 1, 4], [800, 150, 50])
    rows = even_by_fate(np.random.default_rng(0).permutation(fate), 200)
    assert len(rows) == 200
    assert (np.diff(rows) > 0).all()
    shares = np.bincount(np.random.default_rng(0).permutation(fate)[rows], minlength=5)
    np.testing.assert_allclose(shares[[0, 1, 4]], [160, 30, 10], atol=4)


def test_trajectories_hold_the_longest_tracks_in_the_order_of_the_frames(rec):
    frames = order_frames(make_inputs(rec))
    packed = packed_trajectories(rec, frames, [SIZE_PX] * 5, 350)
    lengths = unpack(packed["lengths"], "<u2")
    frame = unpack(packed["frame"], "<u2").astype(int)
    xy = unpack(packed["xy"], "<u2").reshape(-1, 2) / FULL * SIZE_PX
    assert lengths.sum() == len(frame) == len(xy)
    assert 340 < len(frame) <= 350
    assert packed["num"] == len(lengths) < packed["total"] == 400
    assert lengths.min() == rec.track_length().max()
    begin = 0
    for length in lengths[:20]:
        rows = slice(begin, begin + length)
        assert (np.diff(frame[rows]) > 0).all()
        begin += length
        # one of the reconstruction's tracks is seen there
        i, place = frame[rows][0], xy[rows][0]
        there = rec.observations.xy[rec.observations.image_idx == i]
        assert np.linalg.norm(there - place, axis=1).min() < 0.02


def test_the_epipolar_line_of_a_point_passes_through_its_match():
    exact = numbered(make_reconstruction(np.arange(5) * 6.0, window=2, sigma_px=(0.0, 0.0)))
    pair = make_evidence(exact).pairs[0]
    images = make_evidence(exact).images
    xy = [images[pair.names[k]].keypoints[pair.matches[:, k], :2].astype(float) for k in (0, 1)]
    n = hyperplane_of_matches(*xy)
    assert n is not None
    assert np.linalg.norm(n[:4]) == pytest.approx(1.0)
    value = np.hstack([*xy, np.ones((len(xy[0]), 1))]) @ n
    distance = np.abs(value) / np.linalg.norm(n[2:4])
    assert distance.max() < 1e-3
    # and not through another one's
    assert np.median(np.abs(np.hstack([xy[0], xy[1][::-1]]) @ n[:4] + n[4])) > 1.0
    assert hyperplane_of_matches(xy[0][:7], xy[1][:7]) is None


def test_a_pair_is_packed_with_the_earlier_frame_first(rec):
    evidence = make_evidence(rec)
    pair = evidence.pairs[0]
    frame_of = {name: k for k, name in enumerate(rec.image_names)}
    sizes = [SIZE_PX] * 5
    straight = packed_pair(pair, evidence.images, frame_of, sizes, 50)
    backwards = {name: 4 - k for k, name in enumerate(rec.image_names)}
    turned = packed_pair(pair, evidence.images, backwards, sizes, 50)
    assert straight["frames"] == [0, 1]
    assert turned["frames"] == [3, 4]
    assert straight["xy"] == turned["xy"][::-1]
    n, m = np.array(straight["n"]), np.array(turned["n"])
    np.testing.assert_allclose(np.abs(n), np.abs(m[[2, 3, 0, 1, 4]]), rtol=1e-6, atol=1e-9)
    assert straight["num"] == 50
    assert straight["counts"][-1] == len(pair.matches) > 50
