"""Options of the plan: the specimen, the noise of the matches, what the instrument allows."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

from semsfm_colmap.errors import UsageError

Criterion = Literal["mean", "worst"]

MAX_VISIBLE_DEG = 85.0
"""Nearer to grazing a point is a line in the image."""


@dataclass(frozen=True, kw_only=True)
class NoiseOptions:
    """What the estimator is told of the images: noise and priors."""

    noise_px: float = 0.2
    """standard deviation of a coordinate of a match"""
    scale_sigma: float = 0.001
    """relative, of the magnification between images"""
    drift_sigma_px: float = 0.2
    """of the scan drift over the height of a frame; 0: none"""
    visible_deg: float = 60.0
    """a point is matched in the images that lie within this angle of its normal"""


@dataclass(frozen=True, kw_only=True)
class GivenNoise:
    """Of the noise and the priors, what the user gives."""

    noise_px: float | None = None
    """Standard deviation of a coordinate of a match; default: 0.2, as rendered series have after
    the guided pass (0.17 to 0.23, docs/benchmark_vs_colmap.md), of a project what its residuals
    show."""
    scale_sigma: float | None = None
    """Prior: relative standard deviation of the magnification between images; default: 0.001, of a
    project what it was mapped with."""
    drift_sigma_px: float | None = None
    """Prior: standard deviation of the scan drift over the height of a frame; 0: none; default:
    0.2, of a project what it was mapped with."""
    visible_deg: float | None = None
    """A point is matched in the images that lie within this angle of its normal; default: 60."""

    def over(self, told: NoiseOptions) -> NoiseOptions:
        """`told`, but for what is given."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(told, **given)


@dataclass(frozen=True, kw_only=True)
class SpecimenOptions:
    """The specimen of a series that does not exist yet, and the limits of the search."""

    specimen: Literal["body", "field"] = "body"
    """body: a grain that is seen from all sides; field: a flat, rough surface seen from above."""
    size_px: float = 800.0
    """Diameter of the body, side of the field, in the image."""
    num_points: int = 5000
    """Points matched on all of the specimen."""
    max_step_deg: float = 15.0
    """Largest step between neighbouring images: beyond it few matches are found."""
    max_total_deg: float = 360.0
    """Largest total angle that the stage or actuator allows; 360: the turn closes."""
    max_frames: int = 120
    """Most images of a series."""


@dataclass(frozen=True, kw_only=True)
class NextOptions:
    """Which images may be added."""

    num_added: int = 3
    """Images to add."""
    criterion: Criterion = "mean"
    """What they shall lower: the mean depth sigma of the points, or that of the worst twentieth."""
    from_deg: float | None = None
    """Smallest angle allowed, from the first image about the axis of the series; default: 30 below
    the smallest there is."""
    to_deg: float | None = None
    """Largest angle allowed; default: 30 above the largest there is."""
    candidate_step_deg: float = 10.0
    """Distance between the angles that are tried."""
    max_from_nearest_deg: float = 15.0
    """Largest angle to the nearest image, those added before included: beyond it few matches are
    found."""


POSITIVE = (
    "noise_px", "scale_sigma", "visible_deg", "size_px", "num_points", "max_step_deg",
    "max_total_deg",
)  # fmt: skip


def check_options(options: NoiseOptions | SpecimenOptions) -> None:
    """Refuse what no series can have."""
    for field in fields(options):
        value = getattr(options, field.name)
        # also false for nan
        if field.name in POSITIVE and not 0.0 < value < float("inf"):
            raise UsageError(f"--{field.name} is {value}: give a number above 0")
    if isinstance(options, NoiseOptions):
        if not 0.0 <= options.drift_sigma_px < float("inf"):
            raise UsageError(f"--drift_sigma_px is {options.drift_sigma_px}: give 0 or more")
        if options.visible_deg > MAX_VISIBLE_DEG:
            raise UsageError(
                f"--visible_deg is {options.visible_deg:g}: give at most {MAX_VISIBLE_DEG:g}, "
                "nearer to grazing nothing is matched"
            )
        return
    if options.max_total_deg > 360.0:
        raise UsageError(f"--max_total_deg is {options.max_total_deg:g}: give at most 360, a turn")
    if options.max_frames < 3:
        raise UsageError(f"--max_frames is {options.max_frames}: a model needs three images")
