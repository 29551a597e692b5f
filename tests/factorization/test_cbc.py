from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization.blocks import Block, select_blocks, tied_groups
from semsfm_colmap.factorization.cbc import factorize_cbc, largest_tied
from semsfm_colmap.factorization.factorize import (
    factorize,
    factorize_most,
    find_parts,
    rms_with_cameras,
)
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg
from tests.factorization.measurements import observations_from_matrix
from tests.oracles.factorization import factorize_complete


def scene(**options):
    defaults = {"num_images": 12, "range_deg": 70, "num_tracks": 800, "track_window": 5}
    return simulate_tracks(**{**defaults, **options}, rng=np.random.default_rng(11))


def cbc(observations, **options):
    opts = FactorizationOptions(**options)
    blocks = select_blocks(observations, opts)
    return factorize_cbc(blocks, observations.num_images, opts, np.random.default_rng(0))


@pytest.mark.parametrize("gauge", ["orthonormal", "two_cameras"])
@pytest.mark.parametrize("weights", ["signal_to_noise", "uniform"])
def test_noise_free_gaps_are_bridged_exactly(gauge, weights):
    s = scene(noise_px=0.0)
    found = cbc(s.observations, gauge=gauge, block_weights=weights)
    assert rms_with_cameras(found.value.A, found.value.t, s.observations) < 1e-6


def test_complete_factorization_is_the_truncated_svd_and_centred():
    rng = np.random.default_rng(0)
    M = rng.normal(size=(10, 3)) @ rng.normal(size=(3, 40)) + rng.normal(size=(10, 1))
    M += 0.1 * rng.normal(size=M.shape)
    model = factorize_complete(M)
    fit = np.concatenate(
        [A @ model.X.T + t[:, None] for A, t in zip(model.A, model.t, strict=True)]
    )
    centred = M - M.mean(axis=1, keepdims=True)
    singular = np.linalg.svd(centred, compute_uv=False)
    assert np.isclose(np.sum((fit - M) ** 2), np.sum(singular[3:] ** 2))
    assert np.allclose(np.cov(model.X.T, bias=True), np.eye(3))


def test_on_complete_data_cbc_comes_close_to_the_optimum_of_the_svd():
    s = scene(body="field", track_window=0, noise_px=0.3)
    M = s.observations.measurement_matrix()
    optimum = factorize_complete(M)
    best = rms_with_cameras(optimum.A, optimum.t, s.observations)
    found = cbc(s.observations)
    assert best <= rms_with_cameras(found.value.A, found.value.t, s.observations) < 1.05 * best


def test_a_block_is_complete_and_every_image_lies_in_several():
    s = scene()
    blocks = select_blocks(s.observations, FactorizationOptions())
    assert all(np.isfinite(b.M).all() and b.M.shape[1] >= 10 for b in blocks)
    count = np.bincount(np.concatenate([b.images for b in blocks]), minlength=12)
    assert count.min() >= 2
    M = s.observations.measurement_matrix()
    for b in blocks[:5]:
        rows = (2 * b.images[:, None] + [0, 1]).ravel()
        assert np.array_equal(b.M, M[np.ix_(rows, b.tracks)])


def test_wrong_matches_do_not_spoil_the_bases():
    clean, dirty = scene(), scene(outlier_share=0.2)
    e = [
        np.median(
            best_hand_errors_deg(
                factorize(
                    find_parts(s.observations, FactorizationOptions())[0],
                    s.observations,
                    FactorizationOptions(),
                    np.random.default_rng(0),
                ).value.cameras.cam_from_world,
                s.cameras.cam_from_world,
            )
        )
        for s in (clean, dirty)
    ]
    assert e[0] < 0.3
    assert e[1] < 2.0 * e[0] + 0.1


def test_two_halves_without_common_tracks_are_two_parts():
    s = scene(num_images=12, track_window=4)
    obs = s.observations
    left = np.isin(obs.track_idx, np.unique(obs.track_idx[obs.image_idx < 6]))
    right = np.isin(obs.track_idx, np.unique(obs.track_idx[obs.image_idx >= 6]))
    parts = find_parts(obs.select(left != right), FactorizationOptions())
    assert [p.images.tolist() for p in parts] == [list(range(6)), list(range(6, 12))]
    whole = cbc(obs.select(left != right))
    assert whole.status == "disconnected"


def test_an_image_without_tracks_is_named():
    s = scene(body="field", track_window=0)
    found = cbc(s.observations.select(s.observations.image_idx != 3))
    assert found.status == "images_without_block"
    assert found.diagnostics["images_without_block"] == [3]


def test_blocks_do_not_depend_on_the_order_of_the_images():
    s = scene(noise_px=0.0)
    M = s.observations.measurement_matrix()
    order = np.random.default_rng(2).permutation(12)
    shuffled = observations_from_matrix(M.reshape(12, 2, -1)[order].reshape(24, -1))
    found = cbc(shuffled)
    assert rms_with_cameras(found.value.A, found.value.t, shuffled) < 1e-6


def test_the_images_of_the_group_that_holds_the_most_are_the_largest_tied():
    blocks = [np.array(b) for b in ([0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7, 8, 9, 10])]
    group = tied_groups(blocks, 11)
    number, images = largest_tied(blocks, group)
    assert group.tolist() == [1 - number, 1 - number, number, number]
    assert images.tolist() == [4, 5, 6, 7, 8, 9, 10]
    assert len(largest_tied([], tied_groups([], 11))[1]) == 0


def test_a_block_that_shares_one_image_with_each_other_block_has_no_say():
    """Its own tracks move like another body; all images are tied together without it."""
    s = scene(num_images=7, noise_px=0.0, body="field", track_window=0)
    M, tracks = s.observations.measurement_matrix(), np.arange(60)
    blocks = [
        Block(images=np.arange(i, i + 3), tracks=tracks, M=M[2 * i : 2 * i + 6, :60])
        for i in range(5)
    ]
    rng = np.random.default_rng(0)
    other = rng.normal(size=(6, 3)) @ (300.0 * rng.normal(size=(3, 60)))
    odd = Block(images=np.array([0, 3, 6]), tracks=tracks, M=other)
    found = factorize_cbc([*blocks, odd], 7, FactorizationOptions(), np.random.default_rng(0))
    assert rms_with_cameras(found.value.A, found.value.t, s.observations) < 1e-6


def test_where_wrong_blocks_hold_a_part_together_the_tied_images_are_factorized():
    """Eight images whose only ties to four others are tracks that agree on no motion."""
    s = scene(num_images=12, body="field", track_window=0)
    obs = s.observations
    rng = np.random.default_rng(0)
    early = obs.track_idx % 3 == 0
    late = obs.track_idx % 3 == 1
    keep = (early & (obs.image_idx < 8)) | (late & (obs.image_idx >= 8))
    bridge = (obs.track_idx % 3 == 2) & (obs.image_idx >= 6) & (obs.image_idx < 10)
    xy = np.where(bridge[:, None], rng.uniform(0, 1000, obs.xy.shape), obs.xy)
    wrong = replace(obs, xy=xy).select(keep | bridge)
    part = find_parts(wrong, FactorizationOptions())[0]
    assert len(part.images) == 12
    tied, found = factorize_most(part, wrong, FactorizationOptions(), np.random.default_rng(1))
    assert tied.images.tolist() == list(range(8))
    error = best_hand_errors_deg(found.value.cameras.cam_from_world, s.cameras.cam_from_world[:8])
    assert np.median(error) < 0.3
