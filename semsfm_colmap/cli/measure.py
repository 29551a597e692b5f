"""`semsfm measure`: lengths, angles, radii, heights, areas, volumes, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from semsfm_colmap.cli.common import Quiet, parse, positional_first, verbosity
from semsfm_colmap.metrology.sizes.options import MetrologyOptions

DESCRIPTION = """Measure a project's surface (docs/metrology.md). Distances, angles, radii, heights,
areas and volumes of places and regions that PROJECT/measurements.toml names, each with its
uncertainty budget. Writes metrology/measurements.json, .csv and .html."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder, after map; regions, areas and volumes need a mesh."""
    points: tuple[str, ...] = ()
    """Two places for their distance, or three for the angle at the second besides: image:x,y in px
    of the original image, or vertex:number."""
    profile: tuple[str, ...] = ()
    """Two places in one image: heights along the line between them."""
    scale_from: str | None = None
    """A known length in um that sets the scale: place,place,length or place,place,length,sigma."""
    options: Annotated[MetrologyOptions, tyro.conf.arg(name="")] = field(
        default_factory=MetrologyOptions
    )
    quiet: Quiet = False
    """Say nothing but warnings."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.measure import measure

    parsed = parse(Arguments, positional_first(arguments), "measure", DESCRIPTION)
    measure(
        parsed.project_path,
        points=parsed.points,
        profile=parsed.profile,
        scale_from=parsed.scale_from,
        options=parsed.options,
        reporter=verbosity(False, parsed.quiet),
    )
