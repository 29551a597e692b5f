"""`semsfm match`: one stage on a project folder."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import run_stage_command

DESCRIPTION = "Match image pairs and verify them with affine epipolar geometry."


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    run_stage_command("match", ("match",), arguments, DESCRIPTION)
