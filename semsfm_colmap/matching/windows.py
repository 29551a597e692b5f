"""Nearest descriptors where the other image can show them: a window that is predicted.

Between two images of a series a point moves by an affinity of the image plane and, along the
epipolar lines, by its height times the angle. A few hundred matches show both: an affine epipolar
geometry that chance does not explain, the affinity that fits its inliers, and how far relief moves
them along the lines. All keypoints are then compared with those of the other image within that
window only, a hundredth of the image. The window is several times wider across the lines than the
error that verification allows, so that verification still has something to refuse.

Where the few hundred come from, in this order: from matches through a third image between the two
(`through`); from an exact search among the largest keypoints of both. A pair that shows no geometry
either way is searched as a whole; where neighbours were matched and hardly a point lasts from one
image to the other, among large keypoints only. The result depends on the two images, the matches
through others, the options and the seed alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.matching.filters import static_matches
from semsfm_colmap.matching.nearest import NearestMatches, match_nearest
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.ransac import find_affine_fundamental
from semsfm_colmap.matching.window_kernels import search_windows
from semsfm_colmap.types import Array, Float, Int

NUM_LARGE = 1000
"""Keypoints of an image that predict the window: an eightieth of the work of searching 9000."""
NUM_DISTANT = 3000
"""Keypoints that are searched where neighbours have matches that do not reach this far."""
ACROSS = 10.0
"""Half width of a window across the epipolar lines, in units of the error of an inlier."""
QUANTILE = 0.02
"""Share of the inliers at either end whose parallax does not set the length of the window."""
LONGER = 0.5
"""The window is longer than the spread of the parallax by this share at either end."""
MIN_CELL_PX = 16.0
UNSEEN = np.int32(2**31 - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Keypoints:
    """What a search needs of an image, in the order of the database."""

    xy: Float
    """(K, 2) px"""
    scale_px: Float
    """(K,)"""
    descriptors: Array
    """(K, D) uint8 as COLMAP stores them; others are searched as a whole"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """Where the second image may show a point of the first."""

    affinity: Float
    """(2, 3): the middle of the window is ``affinity @ (x, y, 1)``"""
    direction: Float
    """(2,) unit vector along the epipolar lines"""
    low: float
    high: float
    """px along `direction`"""
    across: float
    """px to either side of it"""

    def centre(self, xy: Float) -> Float:
        """Middle of the windows (K, 2) of some points (K, 2)."""
        return np.asarray(xy @ self.affinity[:, :2].T + self.affinity[:, 2])


def match_pair(
    first: Keypoints,
    second: Keypoints,
    options: MatchingOptions,
    rng: np.random.Generator,
    through: Int | None = None,
) -> Int:
    """Matches (L, 2) of a pair, within the predicted window or among all.

    Parameters
    ----------
    through : (T, 2) matches through images in between (`through_third`); None where there are no
        such images

    """
    bytes_of_both = first.descriptors.dtype == second.descriptors.dtype == np.uint8
    if not bytes_of_both or min(len(first.xy), len(second.xy)) <= NUM_LARGE:
        return search_largest(first, second, options)
    window = None
    if through is not None:
        window = predict_window(first.xy[through[:, 0]], second.xy[through[:, 1]], options, rng)
    for number in (NUM_LARGE, None if through is None else NUM_DISTANT):
        if window is None:
            matches = search_largest(first, second, options, number)
            if number is None:
                return matches
            window = predict_window(first.xy[matches[:, 0]], second.xy[matches[:, 1]], options, rng)
    if window is None:
        return matches
    return match_within(
        window, first, second, max_ratio=options.max_ratio, exclusion_px=options.exclusion_px
    ).keypoints


def through_third(first_third: Int, third_second: Int) -> Int:
    """Matches (T, 2) of two images by those of each with a third.

    Parameters
    ----------
    first_third, third_second : (L, 2), (N, 2) matches; a keypoint of the third image has at most
        one in the second

    """
    if not len(first_third) or not len(third_second):
        return np.zeros((0, 2), dtype=np.int64)
    follow = np.full(int(max(first_third[:, 1].max(), third_second[:, 0].max())) + 1, -1)
    follow[third_second[:, 0]] = third_second[:, 1]
    second = follow[first_third[:, 1]]
    return np.column_stack([first_third[:, 0], second])[second >= 0]


def search_largest(
    first: Keypoints, second: Keypoints, options: MatchingOptions, number: int | None = None
) -> Int:
    """Matches (L, 2) by an exact search of so many largest keypoints against as many, or of all."""
    a, b = _largest(first, number), _largest(second, number)
    matches = match_nearest(
        first.descriptors[a],
        second.descriptors[b],
        max_ratio=options.max_ratio,
        xy1=first.xy[a],
        xy2=second.xy[b],
        exclusion_px=options.exclusion_px,
    ).keypoints
    return np.column_stack([a[matches[:, 0]], b[matches[:, 1]]])


def predict_window(
    xy1: Float, xy2: Float, options: MatchingOptions, rng: np.random.Generator
) -> Window | None:
    """The window that matched points (L, 2), (L, 2) ask for; None where they show no geometry."""
    if len(xy1) > NUM_LARGE:
        chosen = np.linspace(0, len(xy1) - 1, NUM_LARGE).astype(np.int64)
        xy1, xy2 = xy1[chosen], xy2[chosen]
    moving = ~static_matches(xy2 - xy1, options.static_radius_px, options.static_excess)
    xy1, xy2 = xy1[moving], xy2[moving]
    found = find_affine_fundamental(
        xy1,
        xy2,
        max_error_px=options.max_error_px,
        min_num_inliers=options.min_num_inliers,
        trials=options.ransac_trials,
        rng=rng,
    )
    if found.value is None:
        return None
    F, inlier = found.value
    return window_of(xy1[inlier], xy2[inlier], F, options.max_error_px)


def window_of(xy1: Float, xy2: Float, F: Float, max_error_px: float) -> Window:
    """The window that matches (L, 2), (L, 2) on an affine epipolar geometry (3, 3) ask for."""
    rows = np.column_stack([xy1, np.ones(len(xy1))])
    affinity = np.linalg.lstsq(rows, xy2, rcond=None)[0].T
    # the epipolar line of a point in the second image is normal to (F13, F23)
    normal = F[:2, 2] / max(float(np.linalg.norm(F[:2, 2])), 1e-300)
    direction = np.array([-normal[1], normal[0]])
    parallax = (xy2 - rows @ affinity.T) @ direction
    low, high = np.quantile(parallax, [QUANTILE, 1.0 - QUANTILE])
    across = ACROSS * max_error_px
    longer = LONGER * (high - low) + across
    return Window(
        affinity=np.asarray(affinity, dtype=np.float64),
        direction=direction,
        low=float(low - longer),
        high=float(high + longer),
        across=across,
    )


def match_within(
    window: Window,
    first: Keypoints,
    second: Keypoints,
    *,
    max_ratio: float,
    exclusion_px: float = -1.0,
) -> NearestMatches:
    """Mutual nearest neighbours within the windows, with Lowe's ratio among those there.

    As `match_nearest` where every other keypoint lies outside; a keypoint that is alone in its
    window has no rival.
    """
    cell_px = max(window.across, MIN_CELL_PX)
    order, cell_begin, origin = cells_of(second.xy, cell_px)
    rows, columns = _unseen(len(first.xy)), _unseen(len(second.xy))
    search_windows(
        first.descriptors.astype(np.int16),
        second.descriptors[order].astype(np.int16),
        np.ascontiguousarray(first.xy, dtype=np.float64),
        np.ascontiguousarray(second.xy[order], dtype=np.float64),
        window.centre(first.xy),
        window.direction,
        window.low,
        window.high,
        window.across,
        cell_begin,
        origin,
        cell_px,
        exclusion_px,
        *rows,
        *columns,
    )
    i = np.flatnonzero(rows[0] >= 0)
    j = rows[0][i]
    mutual = columns[0][j] == i
    i, j = i[mutual], j[mutual]
    ratio = np.maximum(_ratio(rows[1][i], rows[2][i]), _ratio(columns[1][j], columns[2][j]))
    keep = ratio < max_ratio if max_ratio < 1.0 else np.ones(len(i), dtype=bool)
    return NearestMatches(
        keypoints=np.column_stack([i[keep], order[j[keep]]]),
        distance=np.sqrt(rows[1][i[keep]].astype(np.float64)),
        ratio=ratio[keep],
    )


def cells_of(xy: Float, cell_px: float) -> tuple[Int, Int, Float]:
    """Points (K, 2) ordered by square cells, row by row.

    Returns
    -------
    order (K,), the first point of each cell (rows, columns + 1) in that order, corner (2,)

    """
    origin = xy.min(axis=0)
    cell = np.floor((xy - origin) / cell_px).astype(np.int64)
    num_columns, num_rows = (cell.max(axis=0) + 1).tolist()
    flat = cell[:, 1] * num_columns + cell[:, 0]
    order = np.argsort(flat, kind="stable")
    begin = np.searchsorted(flat[order], np.arange(num_rows * num_columns + 1))
    # the end of a row is the beginning of the next one
    columns = np.arange(num_rows)[:, None] * num_columns + np.arange(num_columns + 1)
    return order, begin[columns], origin


def _largest(keypoints: Keypoints, number: int | None) -> Int:
    """So many keypoints of the largest scale, in their order; ties go to the first. None: all."""
    return np.sort(np.argsort(-keypoints.scale_px, kind="stable")[:number])


def _unseen(n: int) -> tuple[Int, Int, Int]:
    return np.full(n, -1, dtype=np.int64), np.full(n, UNSEEN), np.full(n, UNSEEN)


def _ratio(best: Int, second: Int) -> Float:
    """Ratio of distances from their squares; 1 for a tie at zero, 0 where there is no second."""
    ratio = np.sqrt(best / np.maximum(second, 1).astype(np.float64))
    ratio[second == 0] = 1.0
    ratio[second == UNSEEN] = 0.0
    return np.asarray(ratio)
