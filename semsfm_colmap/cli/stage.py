"""A command that runs one stage of an existing project."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import run_stage_command
from semsfm_colmap.pipeline.stage import Stage


def run_stage(stage: Stage, arguments: Sequence[str]) -> None:
    """Run the command of a stage."""
    run_stage_command(stage.name, (stage.name,), arguments, stage.description)
