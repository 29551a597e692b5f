"""`semsfm plan`: how many images over which angle, or which angles to add to a project."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from semsfm_colmap.bounds import Count, CountOrNone, Positive
from semsfm_colmap.cli.common import parse_flags
from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.terminal import show
from semsfm_colmap.planning.options import GivenNoise, NextOptions, SpecimenOptions

DESCRIPTION = """Predict depth and rotation sigmas before the images are taken (docs/plan.md).

  semsfm plan --depth_sigma_px 0.2                   series that reach it, fewest images first
  semsfm plan --num_frames 24 --total_deg 115        what such a series gives
  semsfm plan --project PROJECT                      which angles to add to it next"""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    depth_sigma_px: Positive | None = None
    """Wanted: median standard deviation of the depths, by noise, px."""
    depth_sigma_um: Positive | None = None
    """The same in um; needs --pixel_size_um."""
    num_frames: Count | None = None
    """Images of the series to be predicted, with --total_deg or --step_deg."""
    total_deg: Positive | None = None
    """Its angle from the first image to the last; 360: the turn closes."""
    step_deg: Positive | None = None
    """Its angle between neighbouring images."""
    project: Path | None = None
    """A project folder: which angles to add to it."""
    model: CountOrNone = 0
    """Number of its model below sparse/."""
    pixel_size_um: Positive | None = None
    """Pixel size, for depths in um; a project knows its own."""
    json: Path | None = None
    """Also write the numbers to this file."""
    plot: Path | None = None
    """Also draw a figure, .png."""
    noise: Annotated[GivenNoise, tyro.conf.arg(name="")] = field(default_factory=GivenNoise)
    specimen: Annotated[SpecimenOptions, tyro.conf.arg(name="")] = field(
        default_factory=SpecimenOptions
    )
    add: Annotated[NextOptions, tyro.conf.arg(name="")] = field(default_factory=NextOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parsed = parse_flags(Arguments, arguments, "plan", DESCRIPTION)
    if parsed.plot is not None and parsed.plot.suffix.lower() != ".png":
        raise UsageError(f"{parsed.plot}: plots are written as PNG; give a name that ends in .png")

    from semsfm_colmap.pipeline.plan import plan, write_plot

    answer = plan(
        parsed.project,
        depth_sigma_px=parsed.depth_sigma_px,
        depth_sigma_um=parsed.depth_sigma_um,
        num_frames=parsed.num_frames,
        total_deg=parsed.total_deg,
        step_deg=parsed.step_deg,
        model=parsed.model,
        pixel_size_um=parsed.pixel_size_um,
        noise=parsed.noise,
        specimen=parsed.specimen,
        add=parsed.add,
    )
    show(answer.text(), end="")
    if parsed.json is not None:
        from semsfm_colmap.io.atomic import write_json

        write_json(answer.numbers(), parsed.json, shared=True)
    if parsed.plot is not None:
        write_plot(answer.figure(), parsed.plot)
