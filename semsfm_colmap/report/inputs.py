"""Everything a report is made from, gathered by the caller: the report reads no files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from semsfm_colmap.errors import UsageError
from semsfm_colmap.records import TiltAgreement
from semsfm_colmap.types import PointCloud, Reconstruction, SemSeries, TriangleMesh

ROUND_KEYS = ("threshold_px", "num_kept", "num_dropped")
"""What each filtering round must say; further keys are carried into metrics.json."""


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
    num_after_affine_ransac: int
    num_after_distance_filter: int
    """Verified matches, what the tracks are built from."""
    num_static_rejected: int = 0
    failure: str | None = None
    """Why the pair was rejected as a whole; None when it was kept."""

    @property
    def num_verified(self) -> int:
        """Matches that go on to the tracks: none of a rejected pair."""
        return 0 if self.failure is not None else self.num_after_distance_filter


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportInputs:
    """What the report needs; everything after `series` may be missing."""

    reconstruction: Reconstruction
    series: SemSeries
    """All images that were given, registered or not, in acquisition order."""
    pairs: tuple[PairStatistics, ...] = ()
    stage_times: Mapping[str, float] = field(default_factory=dict)
    """Seconds of each stage, in the order they ran."""
    stage_peak_memory_mb: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    """Whole sentences: warnings and verdicts of the stages, each with its evidence."""
    filtering_rounds: tuple[Mapping[str, Any], ...] = ()
    """One mapping a round with the keys of `ROUND_KEYS`."""
    guided: Mapping[str, Any] = field(default_factory=dict)
    """What the guided second pass found; empty without one."""
    tilt: TiltAgreement | None = None
    """What mapping found of the known tilts: the report carries its judgement."""
    reliability: Mapping[str, Any] = field(default_factory=dict)
    """Total rotation with its error bar, camera models compared, what leaving an image out does."""
    mesh: TriangleMesh | None = None
    cloud: PointCloud | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    twin_written: bool = False
    """True when sparse/1 holds the depth-reversed model."""
    telecentric: Mapping[str, float] = field(default_factory=dict)
    """``focal_length_px`` and ``max_deviation_px`` of the exported pinhole camera."""
    title: str = "SEM reconstruction"

    def __post_init__(self) -> None:
        for number, filtering_round in enumerate(self.filtering_rounds, start=1):
            absent = [key for key in ROUND_KEYS if key not in filtering_round]
            if absent:
                raise UsageError(
                    f"filtering round {number} has {sorted(filtering_round)} but lacks {absent}; "
                    f"give it the keys {list(ROUND_KEYS)}"
                )
        if len(set(self.reconstruction.image_names)) < self.reconstruction.num_images:
            raise UsageError("reconstruction.image_names repeats a name; every image needs its own")
