"""`semsfm example`: a small series rendered, reconstructed and compared with its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.cli.common import Quiet, parse, verbosity
from semsfm_colmap.io.terminal import show

DESCRIPTION = """Render 24 images of a spiny grain, reconstruct them and compare the result with
the truth. A second run goes on where the first one stopped."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    output_path: Path = Path("semsfm_example")
    """Folder that will hold series/, which is rendered, and project/."""
    quiet: Quiet = False
    """Say nothing but warnings and the result."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.example import PROJECT_FOLDER, run_example
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.registry import STAGE_NAMES
    from semsfm_colmap.pipeline.summary import say_summary

    parsed = parse(Arguments, list(arguments), "example", DESCRIPTION)
    reporter = verbosity(False, parsed.quiet)
    record, table = run_example(parsed.output_path, reporter)
    project = Project(parsed.output_path / PROJECT_FOLDER)
    if not parsed.quiet:
        say_summary(project, record, STAGE_NAMES, reporter)
    show(
        f"\nAgainst the truth:\n{table}\n\n"
        f"mesh:         {project.mesh / 'mesh.ply'} (and mesh.glb, mesh.obj)\n"
        f"COLMAP model: {project.sparse / '0'}\n"
        f"report:       {project.report / 'report.html'}"
    )
