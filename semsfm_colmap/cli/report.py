"""`semsfm report`: metrics and HTML report of a project, and a PDF of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from semsfm_colmap.cli.common import StageArguments, run_stage_command, verbosity

DESCRIPTION = "Metrics and HTML report; with --pdf also report/report.pdf, printed by a browser."


@dataclass(frozen=True, kw_only=True)
class ReportArguments(StageArguments):
    """Arguments of the command."""

    pdf: bool = False
    """Print the report to report/report.pdf with an installed Chromium, Chrome or Edge."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parsed = run_stage_command("report", ("report",), arguments, DESCRIPTION, ReportArguments)
    if not parsed.pdf:
        return
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.report_pdf import write_pdf

    folder = Project(parsed.project_path).report
    write_pdf(folder / "report.html", folder / "report.pdf")
    verbosity(parsed.verbose, parsed.quiet).say(f"printed: {folder / 'report.pdf'}")
