"""The two plans, each as text for a terminal, as numbers for a program, and as a figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.planning.next_angles import MappedSeries, NextAngles
from semsfm_colmap.planning.options import Criterion, NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.series import (
    PlannedSeries,
    SeriesSize,
    alternatives,
    best_within_limits,
    curves,
    plan_series,
)
from semsfm_colmap.planning.table import (
    format_next,
    format_series,
    next_numbers,
    series_numbers,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesPlan:
    """Series that could be taken."""

    series: tuple[PlannedSeries, ...]
    """those that reach a wanted sigma, fewest images first, or the one that was asked about"""
    wanted_px: float | None
    """median depth sigma that they shall reach"""
    specimen: SpecimenOptions
    noise: NoiseOptions
    pixel_size_um: float | None

    def text(self) -> str:
        """A line a series."""
        return format_series(self.series, self.pixel_size_um)

    def numbers(self) -> list[dict[str, Any]]:
        """An object a series."""
        return series_numbers(self.series, self.pixel_size_um)

    def figure(self) -> Figure:
        """Depth sigma against the number of images, a curve a total angle."""
        from semsfm_colmap.planning.figures import series_figure

        return series_figure(curves(self.specimen, self.noise), self.series, self.wanted_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class NextPlan:
    """Images to be added to a series that exists."""

    mapped: MappedSeries
    found: NextAngles
    criterion: Criterion
    pixel_size_um: float | None

    def text(self) -> str:
        """A line for the series as it is, and one for each image added."""
        return format_next(self.found, self.mapped, self.pixel_size_um)

    def numbers(self) -> dict[str, Any]:
        """The series as it is, and an object an image added."""
        return next_numbers(self.found, self.mapped, self.pixel_size_um)

    def figure(self) -> Figure:
        """What one more image would do at each angle."""
        from semsfm_colmap.planning.figures import next_figure

        return next_figure(self.found, self.mapped, self.criterion)


def size_of(num_frames: int, total_deg: float | None, step_deg: float | None) -> SeriesSize:
    """The series with so many images over a total angle, or at a step.

    Raises
    ------
    UsageError : neither or both are given, or no series is like that

    """
    if (total_deg is None) == (step_deg is None):
        raise UsageError("--num_frames needs --total_deg or --step_deg, one of them")
    if num_frames < 3:
        raise UsageError(f"--num_frames is {num_frames}: a model needs three images")
    total = total_deg
    if step_deg is not None:
        turns = step_deg * num_frames >= 360.0
        total = step_deg * (num_frames if turns else num_frames - 1)
    assert total is not None
    if total > 360.0:
        raise UsageError(f"{num_frames} images go over {total:g} degrees: give at most 360, a turn")
    return SeriesSize(num_frames=num_frames, total_deg=total)


def one_series(size: SeriesSize, specimen: SpecimenOptions, noise: NoiseOptions) -> PlannedSeries:
    """The prediction for one series.

    Raises
    ------
    InputError : its images leave something undetermined

    """
    series = plan_series(size, specimen, noise)
    if series is None:
        raise InputError(
            f"{size.num_frames} images over {size.total_deg:g} degrees do not determine a model: "
            f"too few points are seen three times within {noise.visible_deg:g} degrees of their "
            "normals; take smaller steps or another total angle"
        )
    return series


def series_reaching(
    depth_sigma_px: float, specimen: SpecimenOptions, noise: NoiseOptions
) -> list[PlannedSeries]:
    """All series that reach a median depth sigma with the fewest images for their total angle.

    Raises
    ------
    InputError : there is none; the best there is is named

    """
    planned = alternatives(depth_sigma_px, specimen, noise)
    if planned:
        return planned
    best = best_within_limits(specimen, noise)
    raise InputError(
        f"no series within the limits reaches {depth_sigma_px:.3g} px: the best, "
        f"{best.size.num_frames} images over {best.size.total_deg:g} degrees, has "
        f"{best.prediction.median_px:.3g} px; allow more images (--max_frames) or a larger total "
        "angle (--max_total_deg), or take images of a higher magnification"
    )
