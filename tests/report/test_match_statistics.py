from dataclasses import asdict

import pytest

from semsfm_colmap.records import PairStatistics
from semsfm_colmap.report.match_statistics import match_statistics, matches_per_frame
from tests.report.series import chain_of_pairs


def test_matches_are_summed_per_frame_and_with_the_next():
    a, b, c, d = names = ("a.png", "b.png", "c.png", "d.png")
    broken = PairStatistics(
        image_name_1=d,
        image_name_2=c,
        num_matches=40,
        num_after_affine_ransac=9,
        num_after_distance_filter=8,
        failure="too few agree",
    )
    pairs = (*chain_of_pairs([a, b, c]), broken)
    rows = matches_per_frame(pairs, names)
    assert [row.num_matches for row in rows] == [100, 200, 140, 40]
    assert [row.num_verified_matches for row in rows] == [75, 150, 75, 0]
    assert [row.num_matches_to_next for row in rows] == [100, 100, 40, None]
    assert [row.num_verified_matches_to_next for row in rows] == [75, 75, 0, None]
    totals = match_statistics(pairs)
    assert totals.num_pairs_verified == 2
    assert totals.verified_fraction == pytest.approx(150 / 240)
    lost = asdict(totals.rejected_fraction)
    assert lost == pytest.approx(
        {
            "static_background": 20 / 240,
            "affine_ransac": (10 + 10 + 31) / 240,
            "distance_filter": (5 + 5 + 1) / 240,
            "rejected_pairs": 8 / 240,
        }
    )
    assert sum(lost.values()) == pytest.approx(1.0 - totals.verified_fraction)
    assert totals.rejected == (broken,)


def test_a_pair_with_an_unknown_image_counts_for_the_known_one_only():
    pairs = chain_of_pairs(["a.png", "elsewhere.png"])
    rows = matches_per_frame(pairs, ["a.png", "b.png", "c.png"])
    assert [row.num_matches for row in rows] == [100, 0, 0]


def test_without_pairs_no_share_is_known():
    totals = match_statistics(())
    assert totals.num_matches == 0
    assert totals.verified_fraction is None
    assert totals.rejected_fraction.affine_ransac is None
