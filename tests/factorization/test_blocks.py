import numpy as np
import pytest

from semsfm_colmap.factorization.blocks import (
    connected_parts,
    covisible_pairs,
    fan_triples,
    grow_block,
    select_blocks,
    tied_groups,
    visibility,
)
from semsfm_colmap.factorization.cbc import leading_basis, ransac_support, subspace_error
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Observations


def scene():
    return simulate_tracks(
        num_images=10,
        range_deg=80,
        num_tracks=600,
        track_window=6,
        rng=np.random.default_rng(3),
    ).observations


def test_common_tracks_are_counted_as_a_dense_product_counts_them():
    obs = scene()
    W = np.zeros((obs.num_images, obs.num_tracks), dtype=int)
    W[obs.image_idx, obs.track_idx] = 1
    common = W @ W.T
    np.fill_diagonal(common, 0)
    assert np.array_equal(visibility(obs).common, common)


def test_a_block_grows_by_the_image_that_keeps_the_most_tracks():
    obs = scene()
    W = np.zeros((obs.num_images, obs.num_tracks), dtype=bool)
    W[obs.image_idx, obs.track_idx] = True
    seen = visibility(obs)
    for pair in covisible_pairs(seen.common, 3, 10)[:6]:
        images, alive = list(pair), W[pair[0]] & W[pair[1]]
        for grown, tracks in grow_block(seen, pair, 5, 10):
            count = (W & alive).sum(axis=1)
            count[images] = -1
            images.append(int(np.argmax(count)))
            alive &= W[images[-1]]
            assert grown == images
            assert np.array_equal(tracks, np.flatnonzero(alive))


def test_neighbours_reach_from_the_closest_to_the_last_with_enough_tracks():
    common = np.zeros((9, 9), dtype=np.int64)
    common[0, 1:] = common[1:, 0] = [80, 70, 60, 50, 40, 30, 20, 5]
    pairs = [p for p in covisible_pairs(common, 3, 10) if p[0] == 0]
    assert (0, 1) in pairs
    assert (0, 7) in pairs
    assert (0, 8) not in pairs


def seldom_seen(num_images=240, num_tracks=48_000, window=40, length=6):
    """Observations of a closed turn, each track seen in a few images of a wide window."""
    rng = np.random.default_rng(5)
    first = rng.integers(0, num_images, num_tracks)
    picked = rng.random((num_tracks, window)).argpartition(length - 1, axis=1)[:, :length]
    image_idx = np.sort((first[:, None] + picked) % num_images, axis=1).ravel()
    n = num_tracks * length
    return Observations(
        image_idx=image_idx,
        track_idx=np.repeat(np.arange(num_tracks), length),
        keypoint_idx=np.arange(n),
        xy=rng.normal(size=(n, 2)),
        num_images=num_images,
        num_tracks=num_tracks,
    )


def test_fans_hold_every_pair_that_a_third_image_supports_and_tie_them():
    obs = seldom_seen()
    seen = visibility(obs)
    pairs = covisible_pairs(seen.common, 6, 10)
    triples = fan_triples(seen, pairs, 10)
    W = np.zeros((obs.num_images, obs.num_tracks), dtype=bool)
    W[obs.image_idx, obs.track_idx] = True
    assert min(int(np.sum(W[i] & W[j] & W[k])) for i, j, k in triples) >= 10
    groups = tied_groups([np.array(t) for t in triples], obs.num_images)
    largest = groups == np.argmax(np.bincount(groups))
    assert np.mean(largest) > 0.99
    assert len(np.unique(np.array(triples)[largest])) == obs.num_images
    held = {pair for i, j, k in triples for pair in ((i, j), (i, k), (j, k))}
    near = [{a + b - i for a, b in pairs if i in (a, b)} for i in range(obs.num_images)]
    for i, j in pairs[::20]:
        third = sorted((near[i] | near[j]) - {i, j})
        supported = np.sum(W[third] & W[i] & W[j], axis=1).max() >= 10
        assert ((i, j) in held) == supported


def test_a_long_series_of_tracks_seen_seldom_is_one_part():
    obs = seldom_seen()
    blocks = select_blocks(obs, FactorizationOptions())
    parts = connected_parts(blocks, obs.num_images)
    assert [len(part.images) for part in parts] == [obs.num_images]
    block = blocks[-1]
    W = np.zeros((obs.num_images, obs.num_tracks), dtype=bool)
    W[obs.image_idx, obs.track_idx] = True
    assert np.array_equal(block.tracks, np.flatnonzero(np.all(W[block.images], axis=0)))
    assert np.all(np.isfinite(block.M))


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_the_subspace_with_the_most_support_leaves_the_wrong_columns_out(share):
    rng = np.random.default_rng(4)
    M = 200.0 * rng.normal(size=(8, 3)) @ rng.normal(size=(3, 300)) + 0.3 * rng.normal(
        size=(8, 300)
    )
    wrong = rng.random(300) < share
    M[:, wrong] += 80.0 * rng.normal(size=(8, int(wrong.sum())))
    inlier = ransac_support(M, 3.0**2 * 4, 200, np.random.default_rng(0))
    assert np.mean(inlier[wrong]) < 0.05
    assert np.mean(inlier[~wrong]) > 0.6
    # the support is of a subspace: a fit to it explains all right columns
    mean, U, _ = leading_basis(M[:, inlier])
    assert np.mean(subspace_error(M, mean, U[:, :3])[~wrong] < 3.0**2 * 4) > 0.98
