"""Write the report's folder: report.html, metrics.json and figures/.

All three are written aside first and then renamed, so that whoever looks sees the old report or the
new one, and never half of either. Other files in the folder are left alone.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.atomic import file_aside, folder_aside
from semsfm_colmap.report.figures import DrawnFigure, draw_figures
from semsfm_colmap.report.html import render_page
from semsfm_colmap.report.images.panels import build_panels
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.json_text import to_json
from semsfm_colmap.report.metrics import Metrics, compute_metrics
from semsfm_colmap.report.metrics_json import metrics_json
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.types import ParallelMap

PAGE, METRICS, FIGURES = "report.html", "metrics.json", "figures"


def _write_figures(figures: tuple[DrawnFigure, ...], folder: Path) -> None:
    for figure in figures:
        if figure.png is not None:
            (folder / f"{figure.name}.png").write_bytes(figure.png)


def write_report(
    inputs: ReportInputs,
    report_path: Path,
    options: ReportOptions | None = None,
    *,
    parallel_map: ParallelMap = map,
    progress: Callable[[int, int], None] | None = None,
) -> Metrics:
    """Compute the metrics, draw the figures and the page, and put them into `report_path`.

    Parameters
    ----------
    parallel_map : for the pictures of the images
    progress : called with the number of figures drawn and their total

    Returns the metrics; raises UsageError when the folder cannot be written.
    """
    metrics = compute_metrics(inputs)
    # the panels' time goes to coders and ray casting, which leave Python to the figures
    with ThreadPoolExecutor(max_workers=1) as beside:
        coming = beside.submit(
            build_panels, inputs, inputs.reconstruction.residuals(), parallel_map=parallel_map
        )
        figures = draw_figures(inputs, metrics, options, progress)
        panels = coming.result()
    page = render_page(inputs, metrics, figures, options, panels)
    try:
        with (
            file_aside(report_path / PAGE) as page_aside,
            file_aside(report_path / METRICS) as metrics_aside,
            folder_aside(report_path / FIGURES) as figures_aside,
        ):
            page_aside.write_text(page, encoding="utf-8")
            metrics_aside.write_text(to_json(metrics_json(metrics)), encoding="utf-8")
            _write_figures(figures, figures_aside)
    except OSError as error:
        raise UsageError(
            f"cannot write the report to {report_path}: {error.strerror or error}; "
            "choose a folder that can be written"
        ) from error
    return metrics
