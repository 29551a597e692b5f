"""`semsfm densify`: one stage on a project folder."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import run_stage_command

DESCRIPTION = "Depth maps by parallel-ray stereo, and their fusion."


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    run_stage_command("densify", ("densify",), arguments, DESCRIPTION)
