"""What stages leave behind: records, written to run.json and read by the report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PairStatistics:
    """What became of the matches of one image pair.

    Static background is dropped first, then the affine RANSAC and the distance filter act, so
    ``num_matches >= num_static_rejected + num_after_affine_ransac`` and
    ``num_after_affine_ransac >= num_after_distance_filter``.
    """

    image_name_1: str
    image_name_2: str
    num_matches: int
    """Descriptor matches, before any filter."""
    num_static_rejected: int = 0
    num_after_affine_ransac: int
    num_after_distance_filter: int
    """Verified matches, what the tracks are built from."""
    failure: str | None = None
    """Why the pair was rejected as a whole; None when it was kept."""

    @property
    def num_verified(self) -> int:
        """Matches that go on to the tracks: none of a rejected pair."""
        return 0 if self.failure is not None else self.num_after_distance_filter
