"""Detectors and descriptors compared, in the report: the paper's figures 3, 12, 13, table 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from semsfm_colmap.report.html_parts import Row, hint, image, table

CAPTIONS = {
    "figure03": "Regions that each detector finds in the first image, the paper's figure 3.",
    "figure12": "Matches of each detector and descriptor, found and after the filters, the paper's "
    "figure 12: what counts is what is left, not what was found.",
    "figure13": "Matches from frame to frame by detector, the paper's figure 13.",
}
NOT_RUN = (
    "Not compared; semsfm compare-features IMAGES --output_path PROJECT/feature_study puts the "
    "paper's figures 12, 13 and table 1 of these images here."
)


@dataclass(frozen=True, kw_only=True)
class FeatureStudy:
    """What the study left, as it was written."""

    overlap: tuple[tuple[str, ...], ...]
    """Rows of table 1 with their header: percent of one detector's regions that another finds"""
    figures: Mapping[str, bytes]
    """PNG by their names in `CAPTIONS`"""


def study_body(study: FeatureStudy | None) -> str:
    """The figures and the table, or how to get them."""
    if study is None:
        return hint(NOT_RUN)
    drawn = "".join(
        image(study.figures[name], caption, picture=True)
        for name, caption in CAPTIONS.items()
        if name in study.figures
    )
    body = f'<div class="figures white">{drawn}</div>' if drawn else ""
    if len(study.overlap) > 1:
        headers, *rows = study.overlap
        body += "<h3>Overlap of the detectors</h3>"
        body += hint(
            "The paper's table 1: percent of the regions of the row's detector that the column's "
            "finds too. Detectors with little overlap add to one another."
        )
        body += table(
            ("detector", *headers[1:]),
            [Row(cells=row) for row in rows],
            text_columns=(0,),
            label="Overlap of the detectors",
        )
    return body
