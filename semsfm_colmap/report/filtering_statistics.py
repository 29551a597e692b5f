"""The rounds of filtering by reprojection error: what each kept and dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from semsfm_colmap.records import FilteringRound


@dataclass(frozen=True, kw_only=True)
class RoundMetrics:
    """One round, and what it dropped of the observations that the round before it kept."""

    record: FilteringRound
    num_dropped: int

    @property
    def num_kept(self) -> int:
        """Observations that are left."""
        return self.record.num_observations

    @property
    def dropped_fraction(self) -> float | None:
        """The share that was dropped; None when there was nothing to drop."""
        num = self.num_kept + self.num_dropped
        return self.num_dropped / num if num else None


def filtering_statistics(rounds: Sequence[FilteringRound]) -> tuple[RoundMetrics, ...]:
    """What each round dropped; the first has none before it, and a round may also win some back."""
    kept = [r.num_observations for r in rounds]
    return tuple(
        RoundMetrics(record=r, num_dropped=max(before - r.num_observations, 0))
        for r, before in zip(rounds, [*kept[:1], *kept[:-1]], strict=True)
    )
