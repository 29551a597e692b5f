import numpy as np

from semsfm_colmap.matching.statistics import pair_statistics
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
