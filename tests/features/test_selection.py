import numpy as np

from semsfm_colmap.features.regions import circular_regions
from semsfm_colmap.features.selection import (
    inside,
    not_duplicated,
    rank_within,
    spread_evenly,
)


def greedily(xy, scale, priority, distance, ratio):
    """The plain way: best first, each drops its near duplicates."""
    keep = np.ones(len(xy), dtype=bool)
    order = np.lexsort((np.arange(len(xy)), priority))
    for n, i in enumerate(order):
        for j in order[:n]:
            if not keep[j]:
                continue
            near = np.hypot(*(xy[i] - xy[j])) < distance * min(scale[i], scale[j])
            if near and abs(np.log(scale[i] / scale[j])) < np.log(ratio):
                keep[i] = False
    return keep


def test_near_duplicates_are_those_of_the_plain_search():
    rng = np.random.default_rng(0)
    for seed_scale in (1.0, 4.0):
        xy = rng.uniform(0, 60, (400, 2))
        scale = seed_scale * np.exp(rng.normal(size=400))
        priority = rng.integers(0, 100, 400)
        found = not_duplicated(xy, scale, priority, distance=0.8, scale_ratio=1.4)
        assert np.array_equal(found, greedily(xy, scale, priority, 0.8, 1.4))
        assert 50 < found.sum() < 390


def test_a_chain_of_neighbours_is_thinned_not_emptied():
    xy = np.column_stack([np.arange(10.0), np.zeros(10)])
    keep = not_duplicated(xy, np.full(10, 3.0), np.arange(10), distance=0.4, scale_ratio=1.3)
    assert keep.tolist() == [True, False] * 5


def test_duplicates_of_other_scales_and_of_nothing_stay():
    xy = np.zeros((2, 2))
    assert not_duplicated(
        xy, np.array([2.0, 4.0]), np.arange(2), distance=0.4, scale_ratio=1.3
    ).all()
    assert len(not_duplicated(xy[:0], np.zeros(0), np.arange(0), distance=1, scale_ratio=1.3)) == 0


def test_ranks_count_from_the_strongest_within_each_group():
    rank = rank_within(np.array([1, 0, 1, 1, 0]), np.array([3.0, 1.0, 9.0, 5.0, 2.0]))
    assert rank.tolist() == [2, 1, 0, 1, 0]


def test_even_selection_takes_from_every_cell_before_a_second_from_any():
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, 100, (2000, 2))
    strength = np.exp(-xy[:, 0] / 5.0)
    regions = circular_regions(xy, np.ones(2000), strength, 0)
    rows = spread_evenly(regions, 200, (100, 100), 10)
    assert len(rows) == 200
    counts = np.histogram2d(*xy[rows].T, bins=10, range=[[0, 100]] * 2)[0]
    assert np.all(counts == 2)
    # and in each cell the strongest
    cell = np.floor(xy / 10).astype(int) @ [1, 10]
    for c in range(100):
        taken = strength[rows][cell[rows] == c]
        assert taken.min() >= np.sort(strength[cell == c])[-2]


def test_features_near_the_border_or_a_mask_are_out_by_their_own_scale():
    distance = np.minimum(*np.mgrid[1:41, 1:41]).astype(np.float32)
    xy = np.array([[5.0, 20.0], [5.0, 20.0], [-3.0, 5.0], [20.0, 55.0]])
    regions = circular_regions(xy, np.array([5.0, 7.0, 1.0, 1.0]), np.ones(4), 0)
    assert inside(regions, distance, 1.0).tolist() == [True, False, False, False]
