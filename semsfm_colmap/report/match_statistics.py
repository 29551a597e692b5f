"""What the matching stage found and dropped: per filter, per frame, per rejected pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.records import PairStatistics


@dataclass(frozen=True, kw_only=True)
class RejectedFractions:
    """Share of all matches that each step dropped; None when there were none."""

    static_background: float | None
    affine_ransac: float | None
    distance_filter: float | None
    rejected_pairs: float | None
    """matches that passed the filters of a pair that was then rejected as a whole"""


@dataclass(frozen=True, kw_only=True)
class MatchMetrics:
    """Sums over all pairs, and the pairs that were rejected as a whole."""

    num_pairs_tried: int
    num_pairs_verified: int
    num_pairs_rejected: int
    num_matches: int
    num_verified_matches: int
    verified_fraction: float | None
    rejected_fraction: RejectedFractions
    rejected: tuple[PairStatistics, ...]


@dataclass(frozen=True, kw_only=True)
class FrameMatches:
    """Matches of one frame, summed over its pairs and with the next frame alone."""

    num_matches: int
    num_verified_matches: int
    num_matches_to_next: int | None
    """None where the pair with the next frame was not tried, and for the last frame"""
    num_verified_matches_to_next: int | None


def _fraction(part: int, whole: int) -> float | None:
    return part / whole if whole > 0 else None


def match_statistics(pairs: Sequence[PairStatistics]) -> MatchMetrics:
    """Sums over all pairs; a match counts as dropped by the first step that dropped it."""
    matches = sum(p.num_matches for p in pairs)
    static = sum(p.num_static_rejected for p in pairs)
    ransac = sum(
        max(0, p.num_matches - p.num_static_rejected - p.num_after_affine_ransac) for p in pairs
    )
    distance = sum(max(0, p.num_after_affine_ransac - p.num_after_distance_filter) for p in pairs)
    verified = sum(p.num_verified for p in pairs)
    lost = sum(p.num_after_distance_filter - p.num_verified for p in pairs)
    return MatchMetrics(
        num_pairs_tried=len(pairs),
        num_pairs_verified=sum(p.failure is None for p in pairs),
        num_pairs_rejected=sum(p.failure is not None for p in pairs),
        num_matches=matches,
        num_verified_matches=verified,
        verified_fraction=_fraction(verified, matches),
        rejected_fraction=RejectedFractions(
            static_background=_fraction(static, matches),
            affine_ransac=_fraction(ransac, matches),
            distance_filter=_fraction(distance, matches),
            rejected_pairs=_fraction(lost, matches),
        ),
        rejected=tuple(p for p in pairs if p.failure is not None),
    )


def matches_per_frame(
    pairs: Sequence[PairStatistics], names: Sequence[str]
) -> tuple[FrameMatches, ...]:
    """Matches of each of the frames `names`, in acquisition order."""
    place = {name: k for k, name in enumerate(names)}
    found = np.zeros(len(names), dtype=np.int64)
    verified = np.zeros(len(names), dtype=np.int64)
    next_found: list[int | None] = [None] * len(names)
    next_verified: list[int | None] = [None] * len(names)
    for pair in pairs:
        ends = [place[n] for n in (pair.image_name_1, pair.image_name_2) if n in place]
        found[ends] += pair.num_matches
        verified[ends] += pair.num_verified
        if len(ends) == 2 and abs(ends[0] - ends[1]) == 1:
            next_found[min(ends)] = pair.num_matches
            next_verified[min(ends)] = pair.num_verified
    return tuple(
        FrameMatches(
            num_matches=int(found[k]),
            num_verified_matches=int(verified[k]),
            num_matches_to_next=next_found[k],
            num_verified_matches_to_next=next_verified[k],
        )
        for k in range(len(names))
    )
