"""Which image pairs to match."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.types import Float, Int

CROSS_GRID = 8
"""So many images of a series are tried against as many of another before more are."""


def select_pairs(
    num_images: int, options: MatchingOptions, angle_rad: Float | None = None
) -> list[tuple[int, int]]:
    """Pairs (i < j) of images numbered in acquisition order.

    All pairs when they are few; else each image with its next `overlap` ones, and with
    `loop_closure` modulo the number of images, so that a full turn closes. With predicted angles
    the next ones are those in angle, and with `loop_closure` also those a whole turn on.

    Parameters
    ----------
    angle_rad : (M,) predicted rotation of each image, in any order and over any number of turns

    """
    exhaustive = options.pairs == "exhaustive" or (
        options.pairs == "auto" and num_images <= options.max_exhaustive_images
    )
    if exhaustive:
        return [(i, j) for i in range(num_images) for j in range(i + 1, num_images)]
    order = (
        range(num_images) if angle_rad is None else np.argsort(angle_rad, kind="stable").tolist()
    )
    pairs = set()
    for i in range(num_images):
        for step in range(1, options.overlap + 1):
            j = i + step
            if j >= num_images:
                if not options.loop_closure:
                    continue
                j %= num_images
            if i != j:
                pairs.add((i, j))
    if angle_rad is not None and options.loop_closure:
        pairs |= _a_turn_on(np.sort(angle_rad), options.overlap)
    return sorted({(min(order[i], order[j]), max(order[i], order[j])) for i, j in pairs})


def _a_turn_on(angle_rad: Float, overlap: int) -> set[tuple[int, int]]:
    """Pairs of positions in increasing angles (M,): each with the `overlap` nearest a turn on."""
    last = len(angle_rad) - 1
    pairs = set()
    for i, angle in enumerate(angle_rad):
        wanted = angle + 2.0 * np.pi
        if wanted > angle_rad[last]:
            break
        nearest = np.argsort(np.abs(angle_rad - wanted), kind="stable")[:overlap]
        pairs |= {(i, int(j)) for j in nearest if j != i}
    return pairs


def select_pairs_of_series(
    series_idx: Int, options: MatchingOptions, angle_rad: Float | None = None
) -> list[tuple[int, int]]:
    """Pairs within each of several series, and a few across any two, evenly spread over both.

    Parameters
    ----------
    series_idx : (M,) number of each image's series; images of a series in acquisition order
    angle_rad : (M,) predicted rotation of each image within its series

    """
    pairs = set()
    members = _members(series_idx)
    for mine in members:
        angle = None if angle_rad is None else angle_rad[mine]
        for i, j in select_pairs(len(mine), options, angle):
            pairs.add((int(mine[i]), int(mine[j])))
    for k, first in enumerate(members):
        for second in members[k + 1 :]:
            pairs |= {_ordered(i, j) for i in _spread(first) for j in _spread(second)}
    return sorted(pairs)


def pairs_around(verified: Iterable[tuple[int, int]], series_idx: Int) -> list[tuple[int, int]]:
    """Pairs across series next to those of the spread ones that were verified.

    Of two images the pair shows that the specimen is seen from similar sides: what lies up to half
    way to the next image that was tried, in either series, may match as well.

    Parameters
    ----------
    verified : pairs of all kinds; those within a series are passed over
    series_idx : as for `select_pairs_of_series`

    """
    members = _members(series_idx)
    place = np.zeros(len(series_idx), dtype=np.int64)
    for mine in members:
        place[mine] = np.arange(len(mine))
    pairs = set()
    for i, j in verified:
        if series_idx[i] != series_idx[j]:
            near_i, near_j = (_near(members[series_idx[k]], int(place[k])) for k in (i, j))
            pairs |= {_ordered(a, b) for a in near_i for b in near_j}
    return sorted(pairs)


def _members(series_idx: Int) -> list[Int]:
    """The images of each series."""
    return [np.flatnonzero(series_idx == k) for k in np.unique(series_idx)]


def _spread(images: Int) -> list[int]:
    """Up to `CROSS_GRID` of the images, the first and the last among them."""
    return images[_places(len(images))].tolist()


def _places(num: int) -> Int:
    return np.unique(np.linspace(0, num - 1, min(num, CROSS_GRID)).round().astype(np.int64))


def _near(images: Int, place: int) -> Sequence[int]:
    """The images that lie at most half way to the next one that is tried."""
    gap = math.ceil((len(images) - 1) / (CROSS_GRID - 1))
    reach = gap // 2
    return images[max(place - reach, 0) : place + reach + 1].tolist()


def _ordered(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i < j else (j, i)
