import pytest

from semsfm_colmap.report.filtering_statistics import filtering_statistics
from tests.report.series import filtering_round


def test_a_round_dropped_what_the_one_before_it_had_more():
    rounds = filtering_statistics([filtering_round(100), filtering_round(90), filtering_round(45)])
    assert [r.num_kept for r in rounds] == [100, 90, 45]
    assert [r.num_dropped for r in rounds] == [0, 10, 45]
    assert [r.dropped_fraction for r in rounds] == pytest.approx([0.0, 0.1, 0.5])


def test_a_round_that_wins_observations_back_dropped_none():
    _, second = filtering_statistics([filtering_round(90), filtering_round(95)])
    assert second.num_dropped == 0


def test_no_share_is_known_where_there_was_nothing():
    (only,) = filtering_statistics([filtering_round(0)])
    assert only.dropped_fraction is None


def test_without_rounds_there_are_none():
    assert filtering_statistics(()) == ()
