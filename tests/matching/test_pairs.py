"""Which pairs of several series are matched."""

import numpy as np
import pytest

from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.pairs import (
    CROSS_GRID,
    pairs_around,
    select_pairs,
    select_pairs_of_series,
)

OPTIONS = MatchingOptions()


def test_one_series_has_the_pairs_that_it_has_by_itself():
    for num in (5, 40):
        alone = select_pairs(num, OPTIONS)
        assert select_pairs_of_series(np.zeros(num, dtype=np.int64), OPTIONS) == alone


def test_within_a_series_nothing_changes_and_the_turns_do_not_close_across():
    series = np.repeat([0, 1], [40, 30])
    pairs = select_pairs_of_series(series, OPTIONS)
    within = [(i, j) for i, j in pairs if series[i] == series[j]]
    second = [(i + 40, j + 40) for i, j in select_pairs(30, OPTIONS)]
    assert within == sorted([*select_pairs(40, OPTIONS), *second])


def test_across_series_a_grid_from_end_to_end_is_tried():
    series = np.repeat([0, 1, 2], [40, 5, 100])
    pairs = select_pairs_of_series(series, OPTIONS)
    assert all(i < j for i, j in pairs)
    across = [(i, j) for i, j in pairs if (series[i], series[j]) == (0, 2)]
    assert len(across) == CROSS_GRID**2
    assert {i for i, _ in across} >= {0, 39}
    assert {j for _, j in across} >= {45, 144}
    few = [(i, j) for i, j in pairs if (series[i], series[j]) == (0, 1)]
    assert {j for _, j in few} == set(range(40, 45))


def test_images_of_a_series_need_not_stand_together():
    series = np.array([0, 1, 0, 1, 0])
    assert (1, 3) in select_pairs_of_series(series, OPTIONS)
    assert pairs_around([(0, 1)], series) == [(0, 1)]


@pytest.mark.parametrize("sizes", [(3, 8), (14, 18), (9, 72), (100, 1000)])
def test_the_surroundings_of_a_grid_leave_no_gap(sizes):
    series = np.repeat([0, 1], sizes)
    tried = select_pairs_of_series(series, OPTIONS)
    assert len(pairs_around(tried, series)) == sizes[0] * sizes[1]


def test_only_what_is_near_a_verified_pair_is_matched_next():
    series = np.repeat([0, 1], [71, 71])  # every tenth is tried
    assert pairs_around([(0, 1), (75, 80)], series) == []
    around = pairs_around([(20, 71)], series)
    assert {i for i, _ in around} == set(range(15, 26))
    assert {j for _, j in around} == set(range(71, 77))
