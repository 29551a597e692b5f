"""The tables and figures of `semsfm compare-features` in a project, for its report."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

from semsfm_colmap.pipeline.project import Project

if TYPE_CHECKING:
    from semsfm_colmap.report.feature_study import FeatureStudy

TABLE = "table1.csv"
FIGURES = ("figure03.png", "figure12.png", "figure13.png")


def read_feature_study(project: Project) -> FeatureStudy | None:
    """What lies in the project's feature_study folder; None where the study was not run there."""
    from semsfm_colmap.report.feature_study import FeatureStudy

    folder = project.feature_study
    if not (folder / TABLE).is_file():
        return None
    with (folder / TABLE).open(newline="", encoding="utf-8") as stream:
        overlap = [tuple(row) for row in csv.reader(stream) if row]
    return FeatureStudy(
        overlap=tuple(overlap),
        figures={
            name.removesuffix(".png"): (folder / name).read_bytes()
            for name in FIGURES
            if (folder / name).is_file()
        },
    )
