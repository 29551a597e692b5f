"""Which regions stay: usable place, near duplicates merged, spread evenly when there are many."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.features.regions import Regions
from semsfm_colmap.types import Array, Bool, Float, Int


def inside(regions: Regions, distance_px: Array, margin: float) -> Bool:
    """True where a region's centre is usable and `margin` scales away from what is not.

    Parameters
    ----------
    distance_px : (H, W), of `pixels.distance_to_unusable`

    """
    if not len(regions):
        return np.zeros(0, dtype=bool)
    h, w = distance_px.shape
    column, row = np.rint(regions.xy).astype(np.int64).T
    within = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    distance = distance_px[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)]
    needed = np.maximum(margin * regions.scale_px, 0.5)
    return np.asarray(within & (distance >= needed))


def rank_within(group: Int, response: Float) -> Int:
    """Rank (K,) of each response among those of its group, 0 the strongest."""
    order = np.lexsort((-response, group))
    sorted_group = group[order]
    start = np.flatnonzero(np.r_[True, sorted_group[1:] != sorted_group[:-1]])
    length = np.diff(np.r_[start, len(group)])
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - np.repeat(start, length)
    return rank


def spread_evenly(regions: Regions, max_num: int, shape: tuple[int, int], cells: int) -> Int:
    """Indices of at most `max_num` regions, strong ones from everywhere.

    The image is cut into square cells; the strongest region of each detector in each cell comes
    first, then the second ones, and so on, so that no bright corner takes all. Strengths of
    different detectors are never compared with each other.
    """
    K = len(regions)
    if max_num <= 0 or max_num >= K:
        return np.arange(K)
    # no more cells than half the features wanted, or strength alone would choose among the cells
    cells = min(cells, max(int((max_num / 2.0) ** 0.5), 1))
    side = max(shape) / cells
    column, row = np.floor(regions.xy / side).astype(np.int64).T
    cell = (row * (cells + 2) + column) * 64 + regions.detector_id
    in_cell = rank_within(cell, regions.response)
    overall = rank_within(regions.detector_id, regions.response)
    order = np.lexsort((overall, in_cell))
    return np.sort(order[:max_num])


def not_duplicated(
    xy: Float, scale_px: Float, priority: Int, *, distance: float, scale_ratio: float
) -> Bool:
    """True for features that stay when near duplicates are dropped, best (smallest) priority first.

    Two features are near duplicates when their distance is below `distance` times the smaller
    scale and their scales differ by less than `scale_ratio`. A feature is dropped only for one that
    stays, so a chain of neighbours is thinned, not emptied. Ties go to the smaller index.
    """
    a, b = _near_pairs(xy, scale_px, distance, scale_ratio)
    place = np.empty(len(xy), dtype=np.int64)
    place[np.lexsort((np.arange(len(xy)), priority))] = np.arange(len(xy))
    better, worse = np.where(place[a] < place[b], (a, b), (b, a))
    keep = np.ones(len(xy), dtype=bool)
    decided = np.zeros(len(xy), dtype=bool)
    while len(better):
        # who has no better undecided neighbour stays; its neighbours go; look again at the rest
        beaten = np.zeros(len(xy), dtype=bool)
        beaten[worse] = True
        decided |= ~beaten
        dropped = worse[~beaten[better]]
        keep[dropped] = False
        decided[dropped] = True
        open_pair = ~(decided[better] | decided[worse])
        better, worse = better[open_pair], worse[open_pair]
    return keep


def _near_pairs(xy: Float, scale_px: Float, distance: float, scale_ratio: float) -> tuple[Int, Int]:
    """Indices of near duplicates; looked up by classes of scale, each search with one radius."""
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    first, second = [none], [none]
    if len(xy) < 2 or distance <= 0.0:
        return none, none
    group = np.floor(np.log(scale_px) / np.log(scale_ratio)).astype(np.int64)
    for g in np.unique(group):
        # pairs within a class, and across to the next one
        rows = np.flatnonzero((group == g) | (group == g + 1))
        radius = distance * float(scale_px[rows].max())
        pairs = cKDTree(xy[rows]).query_pairs(radius, output_type="ndarray")
        a, b = rows[pairs[:, 0]], rows[pairs[:, 1]]
        limit = distance * np.minimum(scale_px[a], scale_px[b])
        near = np.linalg.norm(xy[a] - xy[b], axis=1) < limit
        near &= np.abs(np.log(scale_px[a] / scale_px[b])) < np.log(scale_ratio)
        # pairs of the upper class are found again with it
        near &= (group[a] == g) | (group[b] == g)
        first.append(a[near])
        second.append(b[near])
    return np.concatenate(first), np.concatenate(second)
