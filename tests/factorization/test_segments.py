import itertools
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization import segments as segments_module
from semsfm_colmap.factorization.factorize import factorize, factorize_whole, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.segments import (
    MIN_BLOCKS,
    Segment,
    blocks_wanted,
    cut_into_segments,
    join_segments,
)
from semsfm_colmap.geometry.alignment import align_cameras_both_hands
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import OrthographicCameras


@pytest.fixture(scope="module")
def chain():
    """300 images in steps of a degree, tracks over five of them: a chain of 60 track lengths."""
    return simulate_tracks(
        num_images=300,
        range_deg=300,
        num_tracks=15_000,
        track_window=5,
        scale_drift=0.0005,
        rng=np.random.default_rng(0),
    )


def rotation_error_deg(cameras, true):
    alignments = align_cameras_both_hands(cameras, true)
    return np.rad2deg(min(a.rotation_rms_rad for a in alignments))


def test_a_chain_of_many_track_lengths_stays_straight_in_segments(chain):
    obs, options = chain.observations, FactorizationOptions()
    part = find_parts(obs, options)[0]
    assert len(part.images) == obs.num_images
    start = factorize(part, obs, options, np.random.default_rng(1))
    assert start.value.figures.num_segments > 3
    found = rotation_error_deg(start.value.cameras, chain.cameras)
    assert found < 0.8
    # what it is for: in one piece the chain bends
    assert start.value.figures.eigenvalue_gap > 3.0
    whole = factorize_whole(part, obs, options, np.random.default_rng(1))
    assert whole.value.figures.eigenvalue_gap < 3.0
    assert rotation_error_deg(whole.value.cameras, chain.cameras) > 2.0 * found


def test_segments_cover_all_images_overlap_and_are_stiff(chain):
    obs = chain.observations
    part = find_parts(obs, FactorizationOptions())[0]
    segments = cut_into_segments(part.blocks, obs.num_images)
    assert np.array_equal(
        np.unique(np.concatenate([s.images for s in segments])), np.arange(obs.num_images)
    )
    for a, b in itertools.pairwise(segments):
        assert len(np.intersect1d(a.images, b.images)) >= 0.3 * min(len(a.images), len(b.images))

    def blocks_of_images(blocks):
        return np.bincount(np.concatenate([b.images for b in blocks]), minlength=obs.num_images)

    enough = blocks_wanted(blocks_of_images(part.blocks))
    assert np.max(enough) == MIN_BLOCKS
    for s in segments:
        assert np.all(blocks_of_images(s.blocks)[s.images] >= enough[s.images])


def test_a_short_series_is_not_cut():
    s = simulate_tracks(
        num_images=30, range_deg=90, num_tracks=1500, track_window=10, rng=np.random.default_rng(2)
    )
    part = find_parts(s.observations, FactorizationOptions())[0]
    assert cut_into_segments(part.blocks, len(part.images)) == []


def test_many_images_are_cut_even_when_their_chain_is_short(chain, monkeypatch):
    monkeypatch.setattr(segments_module, "MAX_HOPS", 1000)
    part = find_parts(chain.observations, FactorizationOptions())[0]
    assert cut_into_segments(part.blocks, 300) == []
    monkeypatch.setattr(segments_module, "MAX_IMAGES", 299)
    monkeypatch.setattr(segments_module, "SEGMENT_IMAGES", 50)
    segments = cut_into_segments(part.blocks, 300)
    assert len(segments) > 2
    assert max(len(s.images) for s in segments) <= 60


def segments_of(s, size, step, rng):
    """Pieces of the truth, each in a world and hand of its own."""
    cameras, pieces = s.cameras, []
    for first in range(0, len(cameras) - size + step, step):
        images = np.arange(first, min(first + size, len(cameras)))
        Q = rotation_from_vector(rng.normal(size=3))
        c = 300.0 * rng.normal(size=3)
        mine = cameras.select(images)
        # X = Q x + c
        piece = Segment(
            images=images,
            cameras=OrthographicCameras(
                cam_from_world=mine.cam_from_world @ Q,
                scale_px_per_unit=mine.scale_px_per_unit,
                translation_px=mine.translation_px + mine.projection @ c,
            ),
            points=(s.points[first::size] - c) @ Q,
        )
        pieces.append(piece.reversed() if rng.random() < 0.5 else piece)
    return pieces


def test_exact_segments_join_exactly_whatever_their_worlds_and_hands(chain):
    pieces = segments_of(chain, 40, 20, np.random.default_rng(3))
    cameras, points = join_segments(pieces, 300)
    assert rotation_error_deg(cameras, chain.cameras) < 1e-6
    true = np.concatenate([chain.points[k.images[0] :: 40] for k in pieces])
    # all points project alike, up to the shift and hand of the world
    for hand in align_cameras_both_hands(cameras, chain.cameras):
        if hand.rotation_rms_rad < 1e-8:
            X = hand.true_from_estimated.apply(points)
            assert np.allclose(X - X[0], true - true[0], atol=1e-5)
            assert np.max(np.abs(hand.translation_error_px)) < 1e-5
            assert np.allclose(hand.scale_ratio, 1.0, atol=1e-9)
            return
    raise AssertionError("neither hand fits")


def test_segments_with_too_few_images_in_common_do_not_join(chain):
    pieces = segments_of(chain, 40, 20, np.random.default_rng(3))
    apart = [p for p in pieces if p.images[0] % 40 == 0]
    assert join_segments(apart, 300) is None


def test_segments_of_different_scales_do_not_join(chain):
    pieces = segments_of(chain, 40, 20, np.random.default_rng(3))
    larger = replace(pieces[1].cameras, scale_px_per_unit=1.3 * pieces[1].cameras.scale_px_per_unit)
    pieces[1] = replace(pieces[1], cameras=larger, points=pieces[1].points / 1.3)
    assert join_segments(pieces, 300) is None
