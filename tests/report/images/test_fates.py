import numpy as np

from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.images.evidence import ImageEvidence, PairEvidence
from semsfm_colmap.report.images.fates import SAME_PLACE_PX, Fate, keypoint_fates, region_shapes

VERIFIED = len(MATCH_STEPS) - 1
NONE = np.zeros(0, dtype=np.int64), np.zeros((0, 2))


def image(num, tracked=()):
    xy = 100.0 * np.arange(num)[:, None] * [1.0, 0.5] + 10.0
    in_track = np.zeros(num, dtype=bool)
    in_track[list(tracked)] = True
    return ImageEvidence(keypoints=xy.astype(np.float32), in_track=in_track)


def pair(rows, step, names=("a", "b")):
    return PairEvidence(names=names, matches=np.array(rows).reshape(-1, 2), step=np.array(step))


def test_a_keypoint_is_dropped_by_the_first_stage_that_dropped_it():
    # 0 never matched, 1 dropped by RANSAC, 2 verified only, 3 filtered, 4 kept
    pairs = [pair([[1, 0], [2, 1], [3, 2], [4, 3]], [1, VERIFIED, VERIFIED, VERIFIED])]
    found = keypoint_fates(
        "a", image(5, tracked=(3, 4)), pairs, np.array([4]), np.array([[410.0, 210.0]])
    )
    assert [Fate(f).name for f in found.fate] == [
        "UNMATCHED", "UNVERIFIED", "NO_TRACK", "REJECTED", "KEPT",
    ]  # fmt: skip
    assert found.counts()[Fate.GUIDED] == 0


def test_the_second_image_of_a_pair_is_told_from_the_first():
    pairs = [pair([[4, 0], [3, 1]], [VERIFIED, 0])]
    of_b = keypoint_fates("b", image(3), pairs, *NONE)
    np.testing.assert_array_equal(of_b.fate, [Fate.NO_TRACK, Fate.UNVERIFIED, Fate.UNMATCHED])
    of_other = keypoint_fates("c", image(3), pairs, *NONE)
    assert set(of_other.fate) == {Fate.UNMATCHED}


def test_one_verified_pair_is_enough():
    pairs = [pair([[0, 0]], [1]), pair([[0, 5]], [VERIFIED], names=("a", "c"))]
    assert keypoint_fates("a", image(1), pairs, *NONE).fate[0] == Fate.NO_TRACK


def test_observations_of_the_guided_pass_stand_for_the_keypoint_they_are_at():
    pairs = [pair([[0, 0], [1, 1]], [VERIFIED, VERIFIED])]
    near = 10.0 + 0.9 * SAME_PLACE_PX
    observed = np.array([[near, 10.0], [300.0, 7.0]])
    found = keypoint_fates("a", image(2, tracked=(0, 1)), pairs, np.array([2, 3]), observed)
    np.testing.assert_array_equal(found.fate, [Fate.KEPT, Fate.REJECTED, Fate.GUIDED])
    np.testing.assert_allclose(found.xy[2], [300.0, 7.0])
    assert not found.shape[2].any()


def test_a_guided_observation_does_not_keep_a_keypoint_that_was_in_no_track():
    found = keypoint_fates("a", image(1), [], np.array([1]), np.array([[10.0, 10.0]]))
    np.testing.assert_array_equal(found.fate, [Fate.UNMATCHED, Fate.GUIDED])


def test_regions_are_read_from_scale_and_angle_or_from_the_matrix():
    turned = region_shapes(np.array([[0.0, 0.0, 2.0, np.pi / 2]]))
    np.testing.assert_allclose(turned[0], [[0.0, -2.0], [2.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(
        region_shapes(np.array([[0.0, 0.0, 1.0, 2.0, 3.0, 4.0]]))[0], [[1.0, 2.0], [3.0, 4.0]]
    )
    assert not region_shapes(np.zeros((3, 2))).any()
