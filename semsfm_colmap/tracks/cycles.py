"""Three-view cycles: a match that two other matches contradict is not believed.

A match of keypoint a in image i with b in image j is tested by every third image k in which both
have a match: if a and b meet in the same keypoint c, the cycle i - j - k closes and supports the
match; if they lead to different keypoints, something in the cycle is wrong. Repetitive texture
gives matches that fit the epipolar geometry of a pair and break the cycles (Zach, Klopschitz and
Pollefeys, CVPR 2010, use them on whole pairs).

A match of images far apart is tested by the images between them as well, those that share more
matches with each of the two than the two do: a point that none of them shows is not the same one.
Such matches fit a pair's geometry by chance, and as little else ties images so far apart, a few of
them bend the whole series.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from semsfm_colmap.types import Bool, Int

MIN_BETWEEN = 2
"""Images between two others from which on one of them must show the point."""

Pair = tuple[int, int]


def consistent_matches(
    num_keypoints: Sequence[int], matches: Mapping[Pair, Int]
) -> dict[Pair, Bool]:
    """Which matches are not contradicted by more cycles than support them, nor by those between.

    Parameters
    ----------
    num_keypoints : of each image
    matches : (L, 2) keypoint indices of pairs (i < j), each keypoint at most once a pair

    Returns
    -------
    (L,) of each pair; a match without cycles is kept

    """
    partner: dict[Pair, Int] = {}
    neighbours: dict[int, set[int]] = {}
    for (i, j), rows in matches.items():
        for a, b, p, q in ((i, j, rows[:, 0], rows[:, 1]), (j, i, rows[:, 1], rows[:, 0])):
            to = np.full(num_keypoints[a], -1, dtype=np.int64)
            to[p] = q
            partner[a, b] = to
            neighbours.setdefault(a, set()).add(b)
    count = {(a, b): len(rows) for pair, rows in matches.items() for a, b in (pair, pair[::-1])}
    keep = {}
    for (i, j), rows in matches.items():
        votes = np.zeros(len(rows), dtype=np.int64)
        shown = np.zeros(len(rows), dtype=bool)
        num_between = 0
        for k in neighbours[i] & neighbours[j]:
            via_i, via_j = partner[i, k][rows[:, 0]], partner[j, k][rows[:, 1]]
            both = (via_i >= 0) & (via_j >= 0)
            votes += np.where(both, np.where(via_i == via_j, 1, -1), 0)
            if min(count[i, k], count[j, k]) > len(rows):
                num_between += 1
                shown |= both & (via_i == via_j)
        keep[i, j] = (votes >= 0) & (shown | (num_between < MIN_BETWEEN))
    return keep
