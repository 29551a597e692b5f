"""`semsfm heightmap`: heights of a surface on a grid, and its areal parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from semsfm_colmap.cli.common import Quiet, parse, verbosity
from semsfm_colmap.metrology.heights.height_map_options import HeightMapOptions

DESCRIPTION = """Heights of a project's surface over its own plane, on a grid, with ISO 25178-2
parameters, each with its uncertainty (docs/metrology_areal.md).

Writes PROJECT/metrology/height_map.* (levelled), height_map.png and areal.json."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder, after mesh."""
    to: str = "tif"
    """Formats, by commas: x3p, sdf, gsf, gwy, tif, xyz."""
    region: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1 in px of an original image: what is seen there alone, as one side of a grain."""
    region_image: str | None = None
    """Name of the image that region and profile are in; default: the first one of the model."""
    profile: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1: ends of a line in px of the same image, for profile parameters (ISO 21920-2)."""
    truth_path: Path | None = None
    """Folder of a rendered series: amplification, linearity, flatness and lateral period limit."""
    steps: tuple[tuple[float, float], ...] = ()
    """Known and measured height of steps, two numbers each: amplification and linearity."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    options: tyro.conf.OmitArgPrefixes[HeightMapOptions] = field(default_factory=HeightMapOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.height_map import height_map

    parsed = parse(Arguments, list(arguments), "heightmap", DESCRIPTION)
    height_map(
        parsed.project_path,
        parsed.options,
        to=[name.strip() for name in parsed.to.split(",")],
        region=parsed.region,
        region_image=parsed.region_image,
        profile=parsed.profile,
        truth_path=parsed.truth_path,
        steps=parsed.steps,
        reporter=verbosity(False, parsed.quiet),
    )
