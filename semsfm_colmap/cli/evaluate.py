"""`semsfm evaluate`: compare a project with known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from semsfm_colmap.bounds import CountOrNone
from semsfm_colmap.cli.common import parse
from semsfm_colmap.io.terminal import show

DESCRIPTION = "Compare poses (both hands), structure and mesh of a project with known truth."


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder."""
    truth_path: tyro.conf.Positional[Path]
    """Folder with truth.json and mesh.npz, as `semsfm synthesize` writes it."""
    model: CountOrNone = 0
    """Number of the model below sparse/."""
    json: Path | None = None
    """Also write the figures to this file."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.io.atomic import write_json
    from semsfm_colmap.pipeline.evaluate import evaluate_project

    parsed = parse(Arguments, list(arguments), "evaluate", DESCRIPTION)
    figures, table = evaluate_project(parsed.project_path, parsed.truth_path, model=parsed.model)
    show(table)
    if parsed.json is not None:
        write_json(figures, parsed.json, shared=True)
