"""The example of the README: a small series is rendered, reconstructed, compared with its truth."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.reporter import Reporter

SERIES_FOLDER = "series"
"""What is rendered: images and their truth."""
PROJECT_FOLDER = "project"
"""What is reconstructed from it."""


def run_example(output_path: Path, reporter: Reporter) -> tuple[RunRecord, str]:
    """24 images of a spiny grain become a project; what is there already is kept.

    Parameters
    ----------
    output_path : folder that will hold the series and the project
    reporter : told how far it is

    Returns
    -------
    The content of run.json, and a table of the project's errors against the truth.

    Raises
    ------
    MissingDependencyError
        open3d, which renders and meshes, is not there.

    """
    from semsfm_colmap.io.atomic import folder_aside
    from semsfm_colmap.pipeline.evaluate import evaluate_project
    from semsfm_colmap.pipeline.runner import reconstruct
    from semsfm_colmap.synthetic.options import example_options
    from semsfm_colmap.synthetic.series import synthesize

    import_open3d()  # before a second run goes on with what is rendered, too
    series, project = output_path / SERIES_FOLDER, Project(output_path / PROJECT_FOLDER)
    if not series.exists():
        with folder_aside(series) as aside, reporter.progress("rendering") as progress:
            synthesize(aside, example_options(), progress)
    record = reconstruct(series / "images", project.path, reporter=reporter)
    _, table = evaluate_project(project.path, series)
    return record, table
