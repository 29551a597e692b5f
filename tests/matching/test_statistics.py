import numpy as np

from semsfm_colmap.matching.statistics import background_note, pair_statistics
from semsfm_colmap.records import PairStatistics
from semsfm_colmap.types import AffineTwoViewGeometry


def geometry(**changes):
    matches = np.tile(np.arange(10)[:, None], (1, 2))
    values = {
        "image_pair": (0, 2),
        "keypoints": matches,
        "F": np.zeros((3, 3)),
        "inlier": np.arange(10) < 5,
        "residual_px": np.zeros(10),
        "rejected_by": {"static": 2, "epipolar": 2, "distance": 1},
    }
    return AffineTwoViewGeometry(**{**values, **changes})


def test_each_filter_is_counted_after_the_one_before():
    (pair,) = pair_statistics([geometry()], ["a", "b", "c"])
    assert (pair.image_name_1, pair.image_name_2) == ("a", "c")
    assert (pair.num_matches, pair.num_static_rejected) == (10, 2)
    assert (pair.num_after_affine_ransac, pair.num_after_distance_filter) == (6, 5)
    assert pair.num_verified == 5


def test_a_rejected_pair_passes_nothing_on():
    failed = geometry(F=None, inlier=np.zeros(10, bool), rejected_by={"static": 2}, failure="few")
    (pair,) = pair_statistics([failed], ["a", "b", "c"])
    assert (pair.num_after_affine_ransac, pair.num_verified) == (0, 0)
    assert pair.failure == "few"


def pairs_of(num_static, num_pairs=4):
    return [
        PairStatistics(
            image_name_1="a", image_name_2="b", num_matches=100, num_static_rejected=num_static,
            num_after_affine_ransac=60, num_after_distance_filter=50,
        )
    ] * num_pairs  # fmt: skip


def test_a_background_that_stands_still_is_named_with_the_way_out():
    note = background_note(pairs_of(30))
    assert "30% of the matches, in 4 of 4 pairs" in note
    assert "--masks auto" in note


def test_a_few_that_stand_still_are_not_worth_a_sentence():
    assert background_note(pairs_of(4)) is None
    assert background_note([]) is None
