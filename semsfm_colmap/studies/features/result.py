"""What the study measured: plain rows, and their averages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.studies.features.agreement import Repeatability
from semsfm_colmap.types import Float


@dataclass(frozen=True, kw_only=True)
class PairCount:
    """One image pair with one detector and descriptor."""

    detector: str
    descriptor: str
    first: int
    """Number of the first image among those compared"""
    matched: int
    """Mutual nearest neighbours that pass the ratio"""
    heuristic: int
    """... that the distance filter keeps"""
    robust: int
    """... that agree on an affine epipolar geometry, and pass the filters"""
    true_matched: int = -1
    """Of the matched, those within the tolerance of the true surface; -1 without truth"""
    true_robust: int = -1
    known_matched: int = -1
    """Of the matched, those whose true place is visible"""
    known_robust: int = -1
    error_px: float = float("nan")
    """Median distance of true robust matches from their true place"""


@dataclass(frozen=True, kw_only=True)
class DetectorSpeed:
    """Time of detection and SIFT description on all processors."""

    detector: str
    num_features: int
    seconds: float

    @property
    def microseconds_per_feature(self) -> float:
        """Wall time."""
        return 1e6 * self.seconds / max(self.num_features, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """All figures of one series."""

    series: str
    image_names: tuple[str, ...]
    detectors: tuple[str, ...]
    descriptors: tuple[str, ...]
    counts: tuple[PairCount, ...]
    overlap: Float
    """(D, D) shared regions of two detectors as a share of all of both"""
    speed: tuple[DetectorSpeed, ...]
    repeatability: dict[str, tuple[Repeatability, ...]]
    """By detector, by rising viewing angle; empty without truth"""
    first_images: tuple[Float, ...] = ()
    """Regions of the first image by detector, for figure 3: rows x, y, a11, a12, a21, a22"""
    has_truth: bool = False

    def select(self, detector: str, descriptor: str) -> list[PairCount]:
        """The pairs of one combination, in order."""
        return [c for c in self.counts if (c.detector, c.descriptor) == (detector, descriptor)]

    def select_common(self, detector: str, descriptor: str) -> list[PairCount]:
        """Those that every combination has, so that averages compare the same pairs."""
        firsts: dict[tuple[str, str], set[int]] = {}
        for c in self.counts:
            firsts.setdefault((c.detector, c.descriptor), set()).add(c.first)
        common = set.intersection(*firsts.values()) if firsts else set()
        return [c for c in self.select(detector, descriptor) if c.first in common]


def mean_of(counts: Sequence[PairCount], key: str) -> float:
    """Average of a column over the pairs."""
    values = [getattr(c, key) for c in counts]
    return float(np.mean(values)) if values else 0.0


def precision(counts: Sequence[PairCount], stage: str) -> float:
    """True matches among those whose truth is known: stage is "matched" or "robust"."""
    known = sum(getattr(c, f"known_{stage}") for c in counts)
    return sum(getattr(c, f"true_{stage}") for c in counts) / known if known > 0 else float("nan")
