import numpy as np
import pytest

from semsfm_colmap.factorization.blocks import covisible_pairs, grow_block, visibility
from semsfm_colmap.factorization.cbc import leading_basis, ransac_support, subspace_error
from semsfm_colmap.synthetic.tracks import simulate_tracks


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
