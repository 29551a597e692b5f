"""`semsfm mesh`: one stage on a project folder."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import run_stage_command

DESCRIPTION = "Surface mesh and texture."


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    run_stage_command("mesh", ("mesh",), arguments, DESCRIPTION)
