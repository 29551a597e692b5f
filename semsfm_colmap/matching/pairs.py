"""Which image pairs to match."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.types import Float


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
