"""Simulated series as pairwise matches, with wrong ones added: for the table `added`.

All right matches of a series stay. To each pair of images so many wrong ones come that they are a
given share of all: half of them between any keypoints that have no partner in the other image, half
between such keypoints that lie near each other's epipolar line and move like the right ones, which
is what passes the verification of a pair. Keypoints of nothing (clutter) are added for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.geometry.epipolar import epipolar_residual, estimate_affine_fundamental
from semsfm_colmap.mapping.observations import join_matches
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.verify import verify_pair
from semsfm_colmap.synthetic.tracks import SimulatedTracks
from semsfm_colmap.tracks.options import TrackOptions
from semsfm_colmap.types import Float, Int, Observations

OVERLAP = 10
"""Images up to so far apart are matched."""
MIN_MATCHES = 15
NEAR_PX = 2.0
"""Distance to the epipolar line of the wrong matches that look right: what verification allows."""
NEAR_SIGMAS = 3.0
"""How far, in standard deviations of the right displacements, theirs may be off."""
MAX_FREE = 200
"""Keypoints of an image among which such matches are looked for."""

Pair = tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedMatches:
    """Keypoints of each image and putative matches of pairs, with the truth."""

    keypoints: list[Float]
    point: list[Int]
    """(K,) of each image: the point that a keypoint shows, -1 for clutter"""
    matches: dict[Pair, Int]

    def wrong_share(self, matches: dict[Pair, Int]) -> float:
        """Share of wrong ones among some matches of these keypoints."""
        wrong, total = 0, 0
        for (i, j), rows in matches.items():
            a, b = self.point[i][rows[:, 0]], self.point[j][rows[:, 1]]
            wrong += int(np.sum((a != b) | (a < 0)))
            total += len(rows)
        return wrong / max(total, 1)

    def shown(self, fit: Any) -> tuple[Int, float]:
        """The point that most observations of each track of a fit show, -1 for clutter; share of
        observations that show another one, or clutter.
        """
        obs = fit.observations
        rows = zip(fit.images[obs.image_idx], obs.keypoint_idx, strict=True)
        shown = np.array([self.point[i][k] for i, k in rows])
        point = most_frequent(obs.track_idx, shown, obs.num_tracks)
        return point, float(np.mean((shown != point[obs.track_idx]) | (shown < 0)))


def most_frequent(group: Int, values: Int, num_groups: int) -> Int:
    """The most frequent value (>= -1) of each group; -1 for a group without any: (N,)."""
    keys, count = np.unique(np.column_stack([group, values]), axis=0, return_counts=True)
    order = np.lexsort((-count, keys[:, 0]))
    first = order[np.unique(keys[order, 0], return_index=True)[1]]
    result = np.full(num_groups, -1)
    result[keys[first, 0]] = keys[first, 1]
    return result


def first_of_each(values: Int, chosen: Int) -> Int:
    """Of the rows `chosen` those in which a value occurs for the first time."""
    return chosen[np.sort(np.unique(values[chosen], return_index=True)[1])]


def wrong_matches(xy1: Float, xy2: Float, right: Int, count: int, rng: Any) -> Int:
    """`count` wrong matches (or as many as there is room for) between keypoints without partner."""
    if count == 0:
        return np.zeros((0, 2), dtype=np.int64)
    free1 = np.setdiff1d(np.arange(len(xy1)), right[:, 0])
    free2 = np.setdiff1d(np.arange(len(xy2)), right[:, 1])
    F = estimate_affine_fundamental(xy1[right[:, 0]], xy2[right[:, 1]])
    some1, some2 = rng.permutation(free1)[:MAX_FREE], rng.permutation(free2)[:MAX_FREE]
    a, b = (k.ravel() for k in np.meshgrid(some1, some2, indexing="ij"))
    shift = xy2[right[:, 1]] - xy1[right[:, 0]]
    off = np.abs(xy2[b] - xy1[a] - np.median(shift, axis=0)) / np.std(shift, axis=0)
    near = np.abs(epipolar_residual(F, xy1[a], xy2[b])) < NEAR_PX
    rows = rng.permutation(np.flatnonzero(near & np.all(off < NEAR_SIGMAS, axis=1)))
    rows = first_of_each(b, first_of_each(a, rows))[: count // 2]
    rest1 = rng.permutation(np.setdiff1d(free1, a[rows]))
    rest2 = rng.permutation(np.setdiff1d(free2, b[rows]))
    n = min(count - len(rows), len(rest1), len(rest2))
    return np.concatenate(
        [np.column_stack([a[rows], b[rows]]), np.column_stack([rest1[:n], rest2[:n]])]
    )


def simulate_matches(s: SimulatedTracks, share: float, rng: Any) -> SimulatedMatches:
    """All right matches of a series, and wrong ones: `share` of all."""
    obs = s.observations
    keypoints, point = [], []
    row_of = np.full((obs.num_images, obs.num_tracks), -1)
    odds = share / (1.0 - share)
    for i in range(obs.num_images):
        o = np.flatnonzero(obs.image_idx == i)
        clutter = round(odds * len(o))
        low, high = obs.xy[o].min(axis=0), obs.xy[o].max(axis=0)
        keypoints.append(np.concatenate([obs.xy[o], rng.uniform(low, high, (clutter, 2))]))
        point.append(np.concatenate([obs.track_idx[o], np.full(clutter, -1)]))
        row_of[i, obs.track_idx[o]] = np.arange(len(o))
    matches = {}
    for i in range(obs.num_images):
        for j in range(i + 1, min(i + 1 + OVERLAP, obs.num_images)):
            both = np.flatnonzero((row_of[i] >= 0) & (row_of[j] >= 0))
            if len(both) < MIN_MATCHES:
                continue
            right = np.column_stack([row_of[i, both], row_of[j, both]])
            count = round(odds * len(right))
            wrong = wrong_matches(keypoints[i], keypoints[j], right, count, rng)
            matches[i, j] = rng.permutation(np.concatenate([right, wrong]))
    return SimulatedMatches(keypoints=keypoints, point=point, matches=matches)


def verify(simulated: SimulatedMatches, seed: int) -> dict[Pair, Int]:
    """What the program's verification of each pair leaves."""
    options = MatchingOptions()
    verified = {}
    for (i, j), rows in simulated.matches.items():
        xy1, xy2 = simulated.keypoints[i], simulated.keypoints[j]
        found = verify_pair((i, j), xy1, xy2, rows, options, seed)
        if found.F is not None:
            verified[i, j] = rows[found.inlier]
    return verified


def join(simulated: SimulatedMatches, verified: dict[Pair, Int]) -> Observations:
    """The program's tracks of verified matches."""
    return join_matches(simulated.keypoints, verified, TrackOptions())[0]
