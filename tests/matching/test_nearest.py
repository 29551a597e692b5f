from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.matching import nearest
from semsfm_colmap.matching.nearest import match_nearest, nearest_two
from tests.oracles.nearest import match_nearest_plainly


def two_sets(n1: int, n2: int, dim: int, seed: int = 0, dtype=np.float32):
    """Two sets that share a third of their elements but for noise."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 120, (n1, dim)), rng.uniform(0, 120, (n2, dim))
    shared = min(n1, n2) // 3
    order = rng.permutation(n2)[:shared]
    b[order] = a[:shared] + rng.normal(scale=8.0, size=(shared, dim))
    if dtype == np.uint8:
        a, b = np.clip(np.rint(a), 0, 255), np.clip(np.rint(b), 0, 255)
    return a.astype(dtype), b.astype(dtype), order


@pytest.mark.parametrize("dtype", [np.float32, np.uint8])
@pytest.mark.parametrize("shape", [(300, 211, 128), (90, 400, 36), (64, 64, 3)])
def test_matches_are_those_of_the_plain_search(shape, dtype):
    a, b, _ = two_sets(*shape, dtype=dtype)
    found = match_nearest(a, b, max_ratio=0.8)
    assert len(found.keypoints) > 5
    assert np.array_equal(found.keypoints, match_nearest_plainly(a, b, 0.8))
    i, j = found.keypoints.T
    exact = np.linalg.norm(a[i].astype(float) - b[j].astype(float), axis=1)
    assert np.allclose(found.distance, exact, rtol=1e-6)
    assert np.all(found.ratio < 0.8)


@pytest.mark.parametrize(("block_bytes", "parts"), [(1 << 12, 1), (1 << 16, 2), (1 << 30, 3)])
def test_neither_blocks_nor_parts_nor_who_searches_them_change_the_result(
    monkeypatch, block_bytes, parts
):
    a, b, _ = two_sets(301, 517, 20)
    expected = match_nearest(a, b)
    monkeypatch.setattr(nearest, "BLOCK_BYTES", block_bytes)
    monkeypatch.setattr(nearest, "NUM_PARTS", parts)
    with ThreadPoolExecutor(3) as pool:
        again = match_nearest(a, b, parallel_map=pool.map)
    assert np.array_equal(again.keypoints, expected.keypoints)
    assert np.allclose(again.distance, expected.distance)


def test_swapping_the_images_swaps_the_matches():
    a, b, _ = two_sets(200, 150, 64, dtype=np.uint8)
    forth = match_nearest(a, b).keypoints
    back = match_nearest(b, a).keypoints[:, ::-1]
    assert np.array_equal(forth, back[np.argsort(back[:, 0])])


def test_shared_elements_are_found_and_strangers_are_not():
    a, b, order = two_sets(300, 300, 128)
    found = match_nearest(a, b, max_ratio=0.8).keypoints
    assert np.array_equal(found[:, 0], np.arange(100))
    assert np.array_equal(found[:, 1], order)


def test_without_mutuality_and_ratio_every_descriptor_gets_its_nearest():
    a, b, _ = two_sets(50, 40, 8)
    found = match_nearest(a, b, max_ratio=1.0, mutual=False)
    assert np.array_equal(found.keypoints[:, 0], np.arange(50))


def test_equal_descriptors_are_ambiguous_and_do_not_match():
    same = np.ones((5, 16), dtype=np.float32)
    assert len(match_nearest(same, same).keypoints) == 0
    # ties go to the smaller index, so without the ratio one pair remains
    assert match_nearest(same, same, max_ratio=1.0).keypoints.tolist() == [[0, 0]]


def test_ties_across_blocks_and_parts_go_to_the_smaller_index(monkeypatch):
    monkeypatch.setattr(nearest, "BLOCK_BYTES", 1)
    monkeypatch.setattr(nearest, "NUM_PARTS", 3)
    a = np.zeros((200, 4), dtype=np.float32)
    b = np.zeros((3, 4), dtype=np.float32)
    forward, backward = nearest_two(a, b)
    assert np.all(forward.index == 0)
    assert np.all(backward.index == 0)
    assert np.all(backward.second == 0.0)


def test_one_descriptor_a_side_matches_without_a_second_to_compare():
    one = np.arange(8, dtype=np.float32)[None]
    found = match_nearest(one, one + 1)
    assert found.keypoints.tolist() == [[0, 0]]
    assert found.ratio.tolist() == [0.0]


def test_no_descriptors_give_no_matches():
    empty, some = np.zeros((0, 128), dtype=np.uint8), np.ones((4, 128), dtype=np.uint8)
    for a, b in ((empty, some), (some, empty), (empty, empty)):
        assert match_nearest(a, b).keypoints.shape == (0, 2)


def test_descriptors_of_different_kinds_are_refused():
    with pytest.raises(UsageError, match="different kinds"):
        match_nearest(np.ones((3, 128)), np.ones((3, 36)))
    with pytest.raises(UsageError, match="expected \\(K, D\\)"):
        match_nearest(np.ones(128), np.ones((3, 128)))


def plain_ratio_with_exclusion(a, b, xy, exclusion):
    """(K,) ratio of the nearest to the nearest that lies elsewhere."""
    distance = np.linalg.norm(a[:, None].astype(float) - b[None].astype(float), axis=2)
    ratio = np.zeros(len(a))
    for i, row in enumerate(distance):
        best = row.argmin()
        elsewhere = np.hypot(*(xy - xy[best]).T) > exclusion
        if elsewhere.any():
            ratio[i] = row[best] / row[elsewhere].min()
    return ratio


@pytest.mark.parametrize("parts", [1, 3])
def test_descriptors_of_the_same_spot_are_no_rivals(monkeypatch, parts):
    monkeypatch.setattr(nearest, "NUM_PARTS", parts)
    rng = np.random.default_rng(4)
    spots, copies = 120, 3
    a = rng.uniform(0, 100, (spots, 32)).astype(np.float32)
    b = (a[:, None] + rng.normal(scale=3.0, size=(spots, copies, 32))).astype(np.float32)
    b = b.reshape(-1, 32)
    place = 10.0 * np.column_stack([np.arange(spots), np.zeros(spots)])
    xy2 = np.repeat(place, copies, axis=0) + rng.uniform(-0.3, 0.3, (spots * copies, 2))
    order = rng.permutation(len(b))
    b, xy2 = b[order], xy2[order]
    assert len(match_nearest(a, b, max_ratio=0.6).keypoints) < 20
    found = match_nearest(a, b, max_ratio=0.6, xy1=place, xy2=xy2, exclusion_px=2.0)
    assert len(found.keypoints) == spots
    i, j = found.keypoints.T
    assert np.allclose(place[i], xy2[j], atol=0.5)
    one_way = match_nearest(
        a,
        b,
        max_ratio=1.0,
        mutual=False,
        xy1=place,
        xy2=xy2,
        exclusion_px=2.0,
    )
    assert np.allclose(one_way.ratio, plain_ratio_with_exclusion(a, b, xy2, 2.0), rtol=1e-3)
    # and the other way around, where the copies are rows that the parts share
    back = match_nearest(b, a, max_ratio=0.6, xy1=xy2, xy2=place, exclusion_px=2.0)
    assert np.array_equal(
        back.keypoints[np.argsort(back.keypoints[:, 1])][:, ::-1], found.keypoints
    )


def test_exclusion_needs_positions():
    a = np.ones((4, 8), dtype=np.float32)
    with pytest.raises(UsageError, match="positions"):
        match_nearest(a, a, exclusion_px=2.0)
    with pytest.raises(UsageError, match="a position a descriptor"):
        match_nearest(a, a, xy1=np.zeros((3, 2)), xy2=np.zeros((4, 2)), exclusion_px=2.0)
