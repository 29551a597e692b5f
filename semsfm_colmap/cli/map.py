"""`semsfm map`: one stage on a project folder."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import run_stage_command

DESCRIPTION = "Cameras and points from the verified matches."


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    run_stage_command("map", ("map",), arguments, DESCRIPTION)
