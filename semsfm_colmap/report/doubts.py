"""What to doubt in a result, the largest first; docs/report.md lists every rule."""

from __future__ import annotations

from semsfm_colmap.report.doubt import Doubt
from semsfm_colmap.report.doubts_depth import doubts_about_depth
from semsfm_colmap.report.doubts_images import doubts_about_images
from semsfm_colmap.report.doubts_points import doubts_about_points
from semsfm_colmap.report.metrics import Metrics


def find_doubts(metrics: Metrics) -> list[Doubt]:
    """All doubts, by the relative error that they may stand for."""
    found = (
        *doubts_about_depth(metrics),
        *doubts_about_images(metrics),
        *doubts_about_points(metrics),
    )
    return sorted(found, key=lambda doubt: -doubt.size)
