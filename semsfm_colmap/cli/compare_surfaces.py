"""`semsfm compare`: two surfaces of one specimen, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from semsfm_colmap.bounds import Positive
from semsfm_colmap.cli.common import Quiet, parse_flags, verbosity

DESCRIPTION = """What has changed between the surfaces of two projects of one specimen, before and
after wear, etching or growth: a map of the difference with its bounds, and the volume lost
(docs/metrology_areal.md). Part of the surface must be unchanged."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    before_path: tyro.conf.Positional[Path]
    """Project folder of the earlier surface."""
    after_path: tyro.conf.Positional[Path]
    """Project folder of the later one, in any position."""
    output_path: Path
    """Folder for the results, made anew."""
    to: str = "tif"
    """Formats of the difference, by commas: x3p, sdf, gsf, gwy, tif, xyz."""
    region: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1 in px of an original image of the earlier project: what is seen there alone."""
    region_image: str | None = None
    """Name of that image; default: the first one of the model."""
    free_scale: bool = False
    """The scale of the later surface is found, too: its pixel size is not trusted."""
    spacing: Positive | None = None
    """Distance of the cells in world units; default: mean distance of the mesh's vertices."""
    quiet: Quiet = False
    """Say nothing but warnings."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.compare_surfaces import compare_projects

    parsed = parse_flags(Arguments, list(arguments), "compare", DESCRIPTION)
    compare_projects(
        parsed.before_path,
        parsed.after_path,
        parsed.output_path,
        to=[name.strip() for name in parsed.to.split(",")],
        region=parsed.region,
        region_image=parsed.region_image,
        free_scale=parsed.free_scale,
        spacing=parsed.spacing,
        reporter=verbosity(False, parsed.quiet),
    )
