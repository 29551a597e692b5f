"""Search within predicted windows, against a plain search and by its answers on known scenes."""

import numpy as np
import pytest

from semsfm_colmap.matching import windows
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.windows import (
    Keypoints,
    Window,
    match_pair,
    match_within,
    predict_window,
    search_largest,
    through_third,
    window_of,
)

OPTIONS = MatchingOptions()
SIZE = np.array([800.0, 600.0])


def scene(num=2500, strangers=500, angle_deg=8.0, relief_px=60.0, seed=0, noise=8.0):
    """Two images of points in relief under parallel projection; `num` are in both."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform((0.0, 0.0), SIZE, (num + strangers, 2))
    z = relief_px * np.sin(xy[:, 0] / 90.0) * np.cos(xy[:, 1] / 110.0)
    cos, sin = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    moved = np.column_stack([cos * xy[:, 0] + sin * z + 12.0, xy[:, 1] - 7.0])
    values = rng.gamma(0.7, 30.0, (num + strangers, 128))
    changed = values + rng.normal(scale=noise, size=values.shape)
    # the second image has strangers of its own
    moved[num:] = rng.uniform((0.0, 0.0), SIZE, (strangers, 2))
    changed[num:] = rng.gamma(0.7, 30.0, (strangers, 128))
    scale = rng.gamma(2.0, 1.0, num + strangers) + 1.0
    order = rng.permutation(num + strangers)
    first = Keypoints(xy=xy, scale_px=scale, descriptors=stored(values))
    second = Keypoints(
        xy=(moved + rng.normal(scale=0.2, size=moved.shape))[order],
        scale_px=scale[order],
        descriptors=stored(changed[order]),
    )
    place = np.empty(num + strangers, dtype=int)
    place[order] = np.arange(num + strangers)
    return first, second, place[:num]


def stored(values):
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def within_plainly(window, first, second, max_ratio, exclusion_px):
    """Loops: the nearest and the second nearest in each window, both ways."""
    a, b = first.descriptors.astype(float), second.descriptors.astype(float)
    offset = second.xy[None] - window.centre(first.xy)[:, None]
    along = offset @ window.direction
    across = offset @ np.array([window.direction[1], -window.direction[0]])
    seen = (along >= window.low) & (along <= window.high) & (np.abs(across) <= window.across)
    distance = np.linalg.norm(a[:, None] - b[None], axis=2)
    distance[~seen] = np.inf

    def rival(row, best, xy):
        far = np.linalg.norm(xy - xy[best], axis=1) > max(exclusion_px, 0.0)
        return np.min(row[far], initial=np.inf)

    found = []
    for i, row in enumerate(distance):
        j = int(np.argmin(row))
        if not np.isfinite(row[j]) or np.argmin(distance[:, j]) != i:
            continue
        least = min(rival(row, j, second.xy), rival(distance[:, j], i, first.xy))
        if row[j] < max_ratio * least:
            found.append((i, j))
    return np.array(found)


@pytest.mark.parametrize("exclusion_px", [-1.0, 0.0])
@pytest.mark.parametrize("turn_deg", [0.0, 37.0, 90.0, 200.0])
def test_matches_are_those_of_the_plain_search_within_the_windows(turn_deg, exclusion_px):
    first, second, _ = scene(300, 100)
    turn = np.deg2rad(turn_deg)
    window = Window(
        affinity=np.array([[0.99, 0.0, 12.0], [0.0, 1.0, -7.0]]),
        direction=np.array([np.cos(turn), np.sin(turn)]),
        low=-30.0,
        high=55.0,
        across=21.0,
    )
    found = match_within(window, first, second, max_ratio=0.8, exclusion_px=exclusion_px)
    expected = within_plainly(window, first, second, 0.8, exclusion_px)
    assert len(expected) > 30
    assert np.array_equal(found.keypoints, expected)
    i, j = found.keypoints.T
    a, b = first.descriptors.astype(float), second.descriptors.astype(float)
    assert np.allclose(found.distance, np.linalg.norm(a[i] - b[j], axis=1))


def test_a_predicted_window_finds_what_the_whole_search_finds():
    first, second, place = scene()
    rng = np.random.default_rng(0)
    whole = set(map(tuple, search_largest(first, second, OPTIONS).tolist()))
    found = set(map(tuple, match_pair(first, second, OPTIONS, rng).tolist()))
    true = set(enumerate(place.tolist()))
    assert len(whole & true) > 2000
    assert len(found & true) >= len(whole & true)
    assert len(found - true) < 0.05 * len(found)


def test_the_window_holds_what_relief_moves_and_is_small():
    first, second, place = scene()
    matches = search_largest(first, second, OPTIONS, windows.NUM_LARGE)
    window = predict_window(
        first.xy[matches[:, 0]], second.xy[matches[:, 1]], OPTIONS, np.random.default_rng(0)
    )
    offset = second.xy[place] - window.centre(first.xy[: len(place)])
    along = offset @ window.direction
    assert np.mean((along > window.low) & (along < window.high)) > 0.999
    area = (window.high - window.low) * 2.0 * window.across
    assert area < 0.02 * np.prod(SIZE)


def test_images_with_nothing_in_common_are_searched_as_a_whole():
    first, _, _ = scene(1500, 0, seed=1)
    _, second, _ = scene(1500, 0, seed=2)
    found = match_pair(first, second, OPTIONS, np.random.default_rng(0))
    assert np.array_equal(found, search_largest(first, second, OPTIONS))
    assert len(found) < 15


def test_matches_through_a_third_image_predict_without_a_search(monkeypatch):
    first, second, place = scene()
    whole = match_pair(first, second, OPTIONS, np.random.default_rng(0))
    through = np.column_stack([np.arange(len(place)), place])[::10]
    monkeypatch.setattr(windows, "search_largest", None)
    found = match_pair(first, second, OPTIONS, np.random.default_rng(0), through)
    both = set(map(tuple, whole.tolist())) & set(map(tuple, found.tolist()))
    assert len(both) > 0.99 * len(whole)


def test_matches_are_followed_through_a_third_image():
    first_third = np.array([[0, 4], [1, 2], [5, 9], [6, 0]])
    third_second = np.array([[2, 7], [4, 1], [3, 3]])
    assert through_third(first_third, third_second).tolist() == [[0, 1], [1, 7]]
    assert through_third(first_third[:0], third_second).shape == (0, 2)


@pytest.mark.parametrize("num", [0, 1, 30])
def test_few_keypoints_are_searched_as_a_whole(num):
    first, second, _ = scene(1200, 0)
    few = Keypoints(
        xy=first.xy[:num], scale_px=first.scale_px[:num], descriptors=first.descriptors[:num]
    )
    found = match_pair(few, second, OPTIONS, np.random.default_rng(0))
    assert found.shape[1] == 2
    assert len(found) >= 0.8 * num


def test_a_plane_has_a_window_along_its_epipolar_lines():
    xy = np.random.default_rng(0).uniform(0.0, 500.0, (50, 2))
    F = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    window = window_of(xy, xy, F, 2.0)
    assert np.allclose(np.abs(window.direction), (1.0, 0.0))
    assert window.low < 0.0 < window.high
    assert np.allclose(window.centre(xy), xy)
