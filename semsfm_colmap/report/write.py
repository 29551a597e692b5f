"""Write the report's folder: report.html, metrics.json and figures/.

Everything is written aside first and then renamed into place, so that whoever looks sees the old
report or the new one, and never half of either. Other files in the folder are left alone.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.report.figures import DrawnFigure, draw_figures
from semsfm_colmap.report.html import render_page
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.json_text import to_json
from semsfm_colmap.report.metrics import Metrics, compute_metrics
from semsfm_colmap.report.metrics_json import metrics_json
from semsfm_colmap.report.options import ReportOptions

PAGE, METRICS, FIGURES = "report.html", "metrics.json", "figures"


def write_metrics(metrics: Metrics, path: Path) -> None:
    """Write metrics.json in one step."""
    aside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        aside.write_text(to_json(metrics_json(metrics)), encoding="utf-8")
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)


def _write_figures(figures: tuple[DrawnFigure, ...], folder: Path) -> None:
    folder.mkdir()
    for figure in figures:
        if figure.png is not None:
            (folder / f"{figure.name}.png").write_bytes(figure.png)


def _swap_folder(new: Path, place: Path, attic: Path) -> None:
    """Rename `new` to `place`; what was there goes to `attic` (folders cannot be replaced)."""
    if place.exists():
        place.rename(attic)
    new.rename(place)


def write_report(
    inputs: ReportInputs, report_path: Path, options: ReportOptions | None = None
) -> Metrics:
    """Compute the metrics, draw the figures and the page, and put them into `report_path`.

    Returns the metrics; raises UsageError when the folder cannot be written.
    """
    metrics = compute_metrics(inputs)
    figures = draw_figures(inputs, metrics, options)
    page = render_page(inputs, metrics, figures, options)
    try:
        report_path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=report_path) as folder:
            aside = Path(folder)
            (aside / PAGE).write_text(page, encoding="utf-8")
            write_metrics(metrics, aside / METRICS)
            _write_figures(figures, aside / FIGURES)
            _swap_folder(aside / FIGURES, report_path / FIGURES, aside / "old_figures")
            (aside / METRICS).replace(report_path / METRICS)
            (aside / PAGE).replace(report_path / PAGE)
    except OSError as error:
        raise UsageError(
            f"cannot write the report to {report_path}: {error.strerror or error}; "
            "choose a folder that can be written"
        ) from error
    return metrics
