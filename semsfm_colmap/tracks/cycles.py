"""Three-view cycles: a match that two other matches contradict is not believed.

A match of keypoint a in image i with b in image j is tested by every third image k in which both
have a match: if a and b meet in the same keypoint c, the cycle i - j - k closes and supports the
match; if they lead to different keypoints, something in the cycle is wrong. Repetitive texture
gives matches that fit the epipolar geometry of a pair and break the cycles (Zach, Klopschitz and
Pollefeys, CVPR 2010, use them on whole pairs).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from semsfm_colmap.types import Bool, Int

Pair = tuple[int, int]


def consistent_matches(
    num_keypoints: Sequence[int], matches: Mapping[Pair, Int]
) -> dict[Pair, Bool]:
    """Which matches are not contradicted by more cycles than support them.

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
    keep = {}
    for (i, j), rows in matches.items():
        votes = np.zeros(len(rows), dtype=np.int64)
        for k in neighbours[i] & neighbours[j]:
            via_i, via_j = partner[i, k][rows[:, 0]], partner[j, k][rows[:, 1]]
            both = (via_i >= 0) & (via_j >= 0)
            votes += np.where(both, np.where(via_i == via_j, 1, -1), 0)
        keep[i, j] = votes >= 0
    return keep
