"""Exact mutual nearest neighbours with Lowe's ratio, for descriptors of any kind.

All distances are computed: blocks of ``|a|^2 + |b|^2 - 2 a.b`` by matrix multiplication, in whose
rows and columns the two smallest are kept. Nothing larger than a block is stored. For integer
descriptors (COLMAP's uint8) of up to 2^24 / 255^2 = 258 dimensions the products are exact in
float32.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.matching.nearest_kernels import search_block
from semsfm_colmap.types import Array, Float, Int, ParallelMap

BLOCK_BYTES = 32 << 20
"""Largest block of distances: fits beside others in memory, and is big enough for BLAS."""
NUM_PARTS = 2
"""A block is searched in so many parts at a time, whoever does it: what a second nearest within the
exclusion hides depends on the order, and the result shall not depend on the number of threads."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestMatches:
    """Matches of two descriptor sets, ordered by the index in the first."""

    keypoints: Int
    """(L, 2) indices"""
    distance: Float
    """(L,) Euclidean"""
    ratio: Float
    """(L,) nearest to second nearest distance, the larger of both directions; 0 for no second"""


def match_nearest(
    descriptors1: Array,
    descriptors2: Array,
    *,
    max_ratio: float = 0.8,
    mutual: bool = True,
    parallel_map: ParallelMap = map,
    xy1: Float | None = None,
    xy2: Float | None = None,
    exclusion_px: float = -1.0,
) -> NearestMatches:
    """Match each descriptor of the first set to its nearest one in the second.

    Parameters
    ----------
    descriptors1, descriptors2 : (K1, D), (K2, D)
    max_ratio : nearest to second nearest distance must be below this; in both directions with
        `mutual`; 1 or more switches it off
    mutual : each must be the other's nearest
    parallel_map : over the parts of a block
    xy1, xy2, exclusion_px : positions (K, 2) of both sets; a second nearest within this distance of
        the nearest describes the same spot (another orientation, another simulated view) and is no
        rival in the ratio; below 0 every other descriptor is

    """
    a, b = _checked(descriptors1), _checked(descriptors2)
    if a.shape[1] != b.shape[1]:
        raise UsageError(f"{a.shape=} and {b.shape=}: descriptors of different kinds")
    if not len(a) or not len(b):
        return NearestMatches(
            keypoints=np.zeros((0, 2), dtype=np.int64), distance=np.zeros(0), ratio=np.zeros(0)
        )
    if exclusion_px >= 0.0 and (xy1 is None or xy2 is None):
        raise UsageError(f"{exclusion_px=} needs the positions xy1 and xy2")
    forward, backward = nearest_two(
        a, b, parallel_map=parallel_map, xy1=xy1, xy2=xy2, exclusion_px=exclusion_px
    )
    first = np.arange(len(a))
    second = forward.index
    keep = np.ones(len(a), dtype=bool)
    ratio = _ratio(forward)
    if mutual:
        keep &= backward.index[second] == first
        ratio = np.maximum(ratio, _ratio(backward)[second])
    if max_ratio < 1.0:
        keep &= ratio < max_ratio
    first, second = first[keep], second[keep]
    # once more without the cancellation of |a|^2 + |b|^2 - 2 a.b
    difference = a[first].astype(np.float64) - b[second]
    return NearestMatches(
        keypoints=np.column_stack([first, second]),
        distance=np.sqrt(np.einsum("ld,ld->l", difference, difference)),
        ratio=ratio[keep],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestTwo:
    """For each of K descriptors the nearest in the other set: squared distances, float32."""

    index: Int
    best: Array
    second: Array
    """inf where the other set has one element"""


def nearest_two(
    a: Array,
    b: Array,
    *,
    parallel_map: ParallelMap = map,
    xy1: Float | None = None,
    xy2: Float | None = None,
    exclusion_px: float = -1.0,
) -> tuple[NearestTwo, NearestTwo]:
    """Nearest and second nearest in both directions.

    Ties go to the smaller index. Blocks of rows are multiplied by BLAS, which uses its own
    threads, then searched in parts.
    """
    n1, n2 = len(a), len(b)
    place1 = _positions(xy1, n1)
    place2 = _positions(xy2, n2)
    norm1 = np.einsum("kd,kd->k", a, a)
    norm2 = np.einsum("kd,kd->k", b, b)
    rows = max(64, min(n1, BLOCK_BYTES // (4 * n2)))
    index1, best1, second1 = _empty(n1)
    # one set of column results a part, merged at the end
    columns = [_empty(n2) for _ in range(NUM_PARTS)]
    product = np.empty((min(rows, n1), n2), dtype=np.float32)
    for begin in range(0, n1, rows):
        end = min(begin + rows, n1)
        block = product[: end - begin]
        np.matmul(a[begin:end], b.T, out=block)
        edges = np.linspace(begin, end, NUM_PARTS + 1).astype(int).tolist()

        def search(
            part: int, begin: int = begin, block: Array = block, edges: list[int] = edges
        ) -> None:
            low, high = edges[part : part + 2]
            search_block(
                block[low - begin : high - begin],
                norm1[low:high],
                norm2,
                low,
                index1[low:high],
                best1[low:high],
                second1[low:high],
                *columns[part],
                place1,
                place2,
                exclusion_px,
            )

        deque(parallel_map(search, range(NUM_PARTS)), maxlen=0)
    return (
        NearestTwo(index=index1, best=best1, second=second1),
        _merged(columns, place1, exclusion_px),
    )


def _checked(descriptors: Array) -> Array:
    if descriptors.ndim != 2:
        raise UsageError(f"{descriptors.shape=} but expected (K, D)")
    return np.ascontiguousarray(descriptors, dtype=np.float32)


def _empty(n: int) -> tuple[Int, Array, Array]:
    index = np.full(n, -1, dtype=np.int64)
    return index, np.full(n, np.inf, dtype=np.float32), np.full(n, np.inf, dtype=np.float32)


def _positions(xy: Float | None, num: int) -> Float:
    if xy is None:
        return np.zeros((num, 2))
    if xy.shape != (num, 2):
        raise UsageError(f"{xy.shape=} but expected ({num}, 2), a position a descriptor")
    return np.ascontiguousarray(xy, dtype=np.float64)


def _merged(columns: list[tuple[Int, Array, Array]], xy: Float, exclusion: float) -> NearestTwo:
    """Nearest two of several partial searches."""
    index, best, second = (part.copy() for part in columns[0])
    for index_t, best_t, second_t in columns[1:]:
        better = (best_t < best) | ((best_t == best) & (index_t >= 0) & (index_t < index))
        loser = np.where(better, best, best_t)
        if exclusion >= 0.0:
            # the loser is no rival when it describes the winner's spot
            same = np.linalg.norm(xy[index] - xy[index_t], axis=1) <= exclusion
            loser = np.where(same & (index >= 0) & (index_t >= 0), np.float32(np.inf), loser)
        second = np.minimum(np.where(better, second_t, second), loser)
        index = np.where(better, index_t, index)
        best = np.where(better, best_t, best)
    return NearestTwo(index=index, best=best, second=second)


def _ratio(nearest: NearestTwo) -> Float:
    """Ratio of distances; 1 for a tie at zero, 0 where there is no second."""
    best, second = nearest.best.astype(np.float64), nearest.second.astype(np.float64)
    ratio = np.ones(len(best))
    positive = second > 0.0
    ratio[positive] = np.sqrt(best[positive] / second[positive])
    return ratio
