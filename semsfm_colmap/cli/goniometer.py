"""`semsfm goniometer`: the actuator or stage that turned the specimen, measured by the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from semsfm_colmap.cli.common import Quiet, parse, verbosity

DESCRIPTION = """Axis, angles, wobble and drift of a project's specimen, and the conversion from the
actuator's displacement to degrees (docs/goniometer.md). Writes report/goniometer.json and
report/stage_moves.csv, and makes a report that is there anew."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder, after map."""
    displacement: Path | None = None
    """Table with the columns image and displacement_um; overrides what the series has."""
    quiet: Quiet = False
    """Say nothing but warnings."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.goniometer import measure_rotation

    parsed = parse(Arguments, list(arguments), "goniometer", DESCRIPTION)
    measure_rotation(
        parsed.project_path,
        displacement_path=parsed.displacement,
        reporter=verbosity(False, parsed.quiet),
    )
