"""What a command says when it is done."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.reporter import Reporter

SUMMED_UP = ("map", "mesh", "report")
"""Stages after which there is something to sum up."""
RESULTS = ("report/report.html", "mesh/mesh.ply", "mesh/mesh.glb", "dense/fused.ply", "sparse/0")


def say_summary(
    project: Project, record: RunRecord, stages: Sequence[str], reporter: Reporter
) -> None:
    """The summary of a project after some stages have run; nothing for stages without one."""
    if set(stages).isdisjoint(SUMMED_UP):
        return
    for line in summary(project, record, stages):
        reporter.say(line)


def summary(project: Project, record: RunRecord, stages: Sequence[str]) -> list[str]:
    """The lines; see `report.summary`.

    Parameters
    ----------
    stages : that have run, the last one last: what they do not tell is left out

    """
    from semsfm_colmap.report.metrics import compute_metrics
    from semsfm_colmap.report.metrics_json import metrics_json
    from semsfm_colmap.report.summary import summary_lines

    metrics: Mapping[str, Any] = {}
    if "report" in stages:
        metrics = json.loads((project.report / "metrics.json").read_text(encoding="utf-8"))
    if "verdict" not in metrics:  # no report in this run, or one of an older version
        from semsfm_colmap.pipeline.stages.report import gather_inputs

        inputs = gather_inputs(project, record, surface=not {"mesh", "report"}.isdisjoint(stages))
        metrics = metrics_json(compute_metrics(inputs))
    there = [name for name in results_of(stages) if (project.path / name).exists()]
    return [
        "",
        f"{project.path}",
        *summary_lines(metrics, there, following(project, stages), failed(record, stages)),
    ]


def failed(record: RunRecord, stages: Sequence[str]) -> list[str]:
    """The stages that came to nothing, which was said when it happened."""
    return [f"{name}, see above" for name in stages if record.entry(name).status == "failed"]


def results_of(stages: Sequence[str]) -> tuple[str, ...]:
    """The files that are of these stages, or older than they are."""
    if "report" in stages:
        return RESULTS
    return RESULTS[1:] if "mesh" in stages else RESULTS[-1:]


def following(project: Project, stages: Sequence[str]) -> list[str]:
    """What to type next."""
    path = shlex.quote(str(project.path))
    if "report" in stages:
        return [
            f"open {shlex.quote(str(project.report / 'report.html'))} in a browser",
            f"semsfm view {path} (3-D, sections, lengths)",
            "semsfm measure --help (lengths, areas and volumes with error bars)",
        ]
    after = ["report"] if "mesh" in stages else ["densify", "mesh", "report"]
    return [f"semsfm {name} {path}" for name in after]
