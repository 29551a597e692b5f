"""`semsfm plan`: how many images over which angle, or which angles to add to a project."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from semsfm_colmap.cli.common import parse_flags
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.planning.options import (
    NextOptions,
    NoiseOptions,
    SpecimenOptions,
    check_options,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from semsfm_colmap.planning.series import PlannedSeries

DESCRIPTION = """Predict depth and rotation sigmas before the images are taken (docs/plan.md).

  semsfm plan --depth_sigma_px 0.2                   series that reach it, fewest images first
  semsfm plan --num_frames 24 --total_deg 115        what such a series gives
  semsfm plan --project PROJECT                      which angles to add to it next"""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    depth_sigma_px: float | None = None
    """Wanted: median standard deviation of the depths, by noise, px."""
    depth_sigma_um: float | None = None
    """The same in um; needs --pixel_size_um."""
    num_frames: int | None = None
    """Images of the series to be predicted, with --total_deg or --step_deg."""
    total_deg: float | None = None
    """Its angle from the first image to the last; 360: the turn closes."""
    step_deg: float | None = None
    """Its angle between neighbouring images."""
    project: Path | None = None
    """A project folder: which angles to add to it."""
    model: int = 0
    """Number of its model below sparse/."""
    pixel_size_um: float | None = None
    """Pixel size, for depths in um; a project knows its own."""
    json: Path | None = None
    """Also write the numbers to this file."""
    plot: Path | None = None
    """Also draw a figure, .png."""
    noise: Annotated[NoiseOptions, tyro.conf.arg(name="")] = field(default_factory=NoiseOptions)
    specimen: Annotated[SpecimenOptions, tyro.conf.arg(name="")] = field(
        default_factory=SpecimenOptions
    )
    add: Annotated[NextOptions, tyro.conf.arg(name="")] = field(default_factory=NextOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parsed = parse_flags(Arguments, arguments, "plan", DESCRIPTION)
    check_options(parsed.noise)
    check_options(parsed.specimen)
    for flag in ("pixel_size_um", "depth_sigma_px", "depth_sigma_um", "total_deg", "step_deg"):
        value = getattr(parsed, flag)
        if value is not None and not 0.0 < value < float("inf"):
            raise UsageError(f"--{flag} is {value}: give a number above 0")
    if parsed.plot is not None and parsed.plot.suffix.lower() != ".png":
        raise UsageError(f"{parsed.plot}: plots are written as PNG; give a name that ends in .png")
    wanted = parsed.depth_sigma_px is not None or parsed.depth_sigma_um is not None
    asked = (wanted, parsed.num_frames is not None, parsed.project is not None)
    if sum(asked) != 1:
        raise UsageError(
            "give one of --depth_sigma_px (or _um), --num_frames with --total_deg or --step_deg, "
            "and --project"
        )
    if parsed.project is not None:
        text, numbers, figure = _next(parsed, parsed.project)
    else:
        text, numbers, figure = _series(parsed)
    print(text, end="")
    if parsed.json is not None:
        from semsfm_colmap.io.atomic import write_json

        write_json(numbers, parsed.json, shared=True)
    if parsed.plot is not None and figure is not None:
        from semsfm_colmap.pipeline.plan import write_plot

        write_plot(figure, parsed.plot)


def _next(parsed: Arguments, project: Path) -> tuple[str, Any, Figure | None]:
    """Angles to be added to a project."""
    from semsfm_colmap.pipeline.plan import read_mapped_series
    from semsfm_colmap.planning.figures import next_figure
    from semsfm_colmap.planning.next_angles import next_angles
    from semsfm_colmap.planning.table import format_next, next_numbers

    series, pixel_size_um = read_mapped_series(project, parsed.noise, model=parsed.model)
    pixel_size_um = parsed.pixel_size_um or pixel_size_um
    found = next_angles(series, parsed.add)
    figure = None if parsed.plot is None else next_figure(found, series, parsed.add.criterion)
    text = format_next(found, series, pixel_size_um)
    return text, next_numbers(found, series, pixel_size_um), figure


def _series(parsed: Arguments) -> tuple[str, Any, Figure | None]:
    """Series to be taken: those that reach a wanted sigma, or one."""
    from semsfm_colmap.planning.figures import series_figure
    from semsfm_colmap.planning.series import curves
    from semsfm_colmap.planning.table import format_series, series_numbers

    wanted_px = _wanted_px(parsed)
    planned = [_one(parsed)] if wanted_px is None else _reaching(parsed, wanted_px)
    figure = None
    if parsed.plot is not None:
        figure = series_figure(curves(parsed.specimen, parsed.noise), planned, wanted_px)
    return (
        format_series(planned, parsed.pixel_size_um),
        series_numbers(planned, parsed.pixel_size_um),
        figure,
    )


def _wanted_px(parsed: Arguments) -> float | None:
    """The wanted depth sigma; None where none was given."""
    if parsed.depth_sigma_um is None:
        return parsed.depth_sigma_px
    if parsed.depth_sigma_px is not None:
        raise UsageError("give --depth_sigma_px or --depth_sigma_um, not both")
    if parsed.pixel_size_um is None:
        raise UsageError("--depth_sigma_um needs the pixel size: give --pixel_size_um, too")
    return parsed.depth_sigma_um / parsed.pixel_size_um


def _one(parsed: Arguments) -> PlannedSeries:
    """The series that was asked about."""
    from semsfm_colmap.planning.series import SeriesSize, plan_series

    frames, total = parsed.num_frames, parsed.total_deg
    if frames is None or (total is None) == (parsed.step_deg is None):
        raise UsageError("--num_frames needs --total_deg or --step_deg, one of them")
    if frames < 3:
        raise UsageError(f"--num_frames is {frames}: a model needs three images")
    if parsed.step_deg is not None:
        total = parsed.step_deg * (frames if parsed.step_deg * frames >= 360.0 else frames - 1)
    assert total is not None
    if total > 360.0:
        raise UsageError(f"{frames} images go over {total:g} degrees: give at most 360, a turn")
    series = plan_series(
        SeriesSize(num_frames=frames, total_deg=total), parsed.specimen, parsed.noise
    )
    if series is None:
        raise InputError(
            f"{frames} images over {total:g} degrees do not determine a model: too few points are "
            f"seen three times within {parsed.noise.visible_deg:g} degrees of their normals; take "
            "smaller steps or another total angle"
        )
    return series


def _reaching(parsed: Arguments, wanted_px: float) -> list[PlannedSeries]:
    """All series that reach a sigma with the fewest images."""
    from semsfm_colmap.planning.series import alternatives, best_within_limits

    planned = alternatives(wanted_px, parsed.specimen, parsed.noise)
    if planned:
        return planned
    best = best_within_limits(parsed.specimen, parsed.noise)
    raise InputError(
        f"no series within the limits reaches {wanted_px:.3g} px: the best, {best.size.num_frames} "
        f"images over {best.size.total_deg:g} degrees, has {best.prediction.median_px:.3g} px; "
        "allow more images (--max_frames) or a larger total angle (--max_total_deg), or take "
        "images of a higher magnification"
    )
