import numpy as np
import pytest

from semsfm_colmap.studies.features.agreement import overlap_share, repeatability, shared_regions


def test_regions_are_shared_when_near_in_place_and_scale():
    xy = np.array([[10.0, 10.0], [30.0, 10.0], [50.0, 10.0], [np.nan, 5.0]])
    other = np.array([[10.8, 10.0], [30.2, 10.0], [54.0, 10.0]])
    scale = np.array([2.0, 2.0, 2.0, 2.0])
    pairs = shared_regions(xy, scale, other, np.array([2.2, 5.0, 2.0]), max_px=1.5, scale_ratio=1.5)
    assert pairs.tolist() == [[0, 0]]


def test_each_region_is_shared_once():
    xy = np.array([[10.0, 10.0], [10.4, 10.0]])
    pairs = shared_regions(
        xy, np.ones(2), np.array([[10.5, 10.0]]), np.ones(1), max_px=1.5, scale_ratio=1.5
    )
    assert pairs.tolist() == [[1, 0]]


def test_nothing_is_shared_with_nothing():
    none = np.zeros((0, 2))
    some = np.ones((3, 2))
    for a, b in ((none, some), (some, none)):
        pairs = shared_regions(a, np.ones(len(a)), b, np.ones(len(b)), max_px=1, scale_ratio=2)
        assert pairs.shape == (0, 2)


def test_overlap_is_a_share_of_all_regions_of_both():
    assert overlap_share(50, 100, 50) == 0.5
    assert overlap_share(0, 10, 10) == 0.0
    assert overlap_share(0, 0, 0) == 0.0
    assert overlap_share(7, 7, 7) == 1.0


def test_repeatability_counts_only_what_the_other_image_can_show():
    predicted = np.array([[10.0, 10.0], [20.0, 20.0], [np.nan, np.nan], [500.0, 3.0]])
    found = repeatability(
        predicted,
        np.ones(4),
        np.array([[10.3, 10.4], [90.0, 90.0]]),
        np.ones(2),
        usable=np.array([True, True, True, False]),
        angle_deg=5.0,
        max_px=2.0,
        scale_ratio=1.5,
    )
    assert (found.num_visible, found.num_repeated) == (2, 1)
    assert found.share == 0.5
    assert found.error_px == pytest.approx(0.5)
