"""What to doubt in a result, the largest first; docs/report.md lists every rule."""

from __future__ import annotations

from semsfm_colmap.report.doubt import Doubt
from semsfm_colmap.report.doubts_depth import doubts_about_depth
from semsfm_colmap.report.doubts_images import doubts_about_images
from semsfm_colmap.report.doubts_notes import doubts_from_notes
from semsfm_colmap.report.doubts_points import doubts_about_points
from semsfm_colmap.report.metrics import Metrics


def find_doubts(metrics: Metrics) -> list[Doubt]:
    """All doubts, by the relative error that they may stand for."""
    of_numbers = [
        *doubts_about_depth(metrics),
        *doubts_about_images(metrics),
        *doubts_about_points(metrics),
    ]
    said = tuple(start for doubt in of_numbers for start in doubt.covers)
    found = [*of_numbers, *doubts_from_notes(metrics, said)]
    return sorted(found, key=lambda doubt: -doubt.size)
