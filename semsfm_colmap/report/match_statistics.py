"""What the matching stage found and dropped: per filter, per frame, per rejected pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from semsfm_colmap.records import PairStatistics


def _fraction(part: int, whole: int) -> float | None:
    return part / whole if whole > 0 else None


def match_totals(pairs: Sequence[PairStatistics]) -> dict[str, Any]:
    """Sums over all pairs, and the share of all matches that each step dropped.

    A match counts as dropped by the first step that dropped it; "rejected_pairs" are the matches
    that passed the filters of a pair that was then rejected as a whole.
    """
    matches = sum(p.num_matches for p in pairs)
    static = sum(p.num_static_rejected for p in pairs)
    ransac = sum(
        max(0, p.num_matches - p.num_static_rejected - p.num_after_affine_ransac) for p in pairs
    )
    distance = sum(max(0, p.num_after_affine_ransac - p.num_after_distance_filter) for p in pairs)
    verified = sum(p.num_verified for p in pairs)
    lost = sum(p.num_after_distance_filter - p.num_verified for p in pairs)
    return {
        "num_pairs_tried": len(pairs),
        "num_pairs_verified": sum(p.failure is None for p in pairs),
        "num_pairs_rejected": sum(p.failure is not None for p in pairs),
        "num_matches": matches,
        "num_verified_matches": verified,
        "verified_fraction": _fraction(verified, matches),
        "rejected_fraction": {
            "static_background": _fraction(static, matches),
            "affine_ransac": _fraction(ransac, matches),
            "distance_filter": _fraction(distance, matches),
            "rejected_pairs": _fraction(lost, matches),
        },
    }


def matches_per_frame(
    pairs: Sequence[PairStatistics], names: Sequence[str]
) -> dict[str, Sequence[int | None]]:
    """Matches of each frame, summed over its pairs and with the next frame alone.

    ``None`` where the pair with the next frame was not tried (and for the last frame).
    """
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
    return {
        "num_matches": found.tolist(),
        "num_verified_matches": verified.tolist(),
        "num_matches_to_next": next_found,
        "num_verified_matches_to_next": next_verified,
    }


def rejected_pairs(pairs: Sequence[PairStatistics]) -> list[dict[str, Any]]:
    """The pairs that were rejected as a whole, with the reason."""
    return [
        {
            "image_name_1": p.image_name_1,
            "image_name_2": p.image_name_2,
            "num_matches": p.num_matches,
            "num_static_rejected": p.num_static_rejected,
            "num_after_affine_ransac": p.num_after_affine_ransac,
            "num_after_distance_filter": p.num_after_distance_filter,
            "failure": p.failure,
        }
        for p in pairs
        if p.failure is not None
    ]
