"""Options of the plan: the specimen, the noise of the matches, what the instrument allows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from annotated_types import Ge, Interval

from semsfm_colmap.bounds import Checked, Count, NotNegative, Positive

Criterion = Literal["mean", "worst"]

MAX_VISIBLE_DEG = 85.0
"""Nearer to grazing a point is a line in the image."""
VisibleAngle = Annotated[float, Interval(gt=0, le=MAX_VISIBLE_DEG)]
Turn = Annotated[float, Interval(gt=0, le=360)]


@dataclass(frozen=True, kw_only=True)
class NoiseOptions(Checked):
    """What the estimator is told of the images: noise and priors."""

    noise_px: Positive = 0.2
    """standard deviation of a coordinate of a match"""
    scale_sigma: Positive = 0.001
    """relative, of the magnification between images"""
    drift_sigma_px: NotNegative = 0.2
    """of the scan drift over the height of a frame; 0: none"""
    visible_deg: VisibleAngle = 60.0
    """a point is matched in the images that lie within this angle of its normal"""


@dataclass(frozen=True, kw_only=True)
class GivenNoise(Checked):
    """Of the noise and the priors, what the user gives."""

    noise_px: Positive | None = None
    """Standard deviation of a coordinate of a match; default: 0.2, as rendered series have after
    the guided pass (0.17 to 0.23, docs/benchmark_vs_colmap.md), of a project what its residuals
    show."""
    scale_sigma: Positive | None = None
    """Prior: relative standard deviation of the magnification between images; default: 0.001, of a
    project what it was mapped with."""
    drift_sigma_px: NotNegative | None = None
    """Prior: standard deviation of the scan drift over the height of a frame; 0: none; default:
    0.2, of a project what it was mapped with."""
    visible_deg: VisibleAngle | None = None
    """A point is matched in the images that lie within this angle of its normal; default: 60."""

    def over(self, told: NoiseOptions) -> NoiseOptions:
        """`told`, but for what is given."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(told, **given)


@dataclass(frozen=True, kw_only=True)
class SpecimenOptions(Checked):
    """The specimen of a series that does not exist yet, and the limits of the search."""

    specimen: Literal["body", "field"] = "body"
    """body: a grain that is seen from all sides; field: a flat, rough surface seen from above."""
    size_px: Positive = 800.0
    """Diameter of the body, side of the field, in the image."""
    num_points: Count = 5000
    """Points matched on all of the specimen."""
    max_step_deg: Positive = 15.0
    """Largest step between neighbouring images: beyond it few matches are found."""
    max_total_deg: Turn = 360.0
    """Largest total angle that the stage or actuator allows; 360: the turn closes."""
    max_frames: Annotated[int, Ge(3)] = 120
    """Most images of a series."""


@dataclass(frozen=True, kw_only=True)
class NextOptions(Checked):
    """Which images may be added."""

    num_added: Count = 3
    """Images to add."""
    criterion: Criterion = "mean"
    """What they shall lower: the mean depth sigma of the points, or that of the worst twentieth."""
    from_deg: float | None = None
    """Smallest angle allowed, from the first image about the axis of the series; default: 30 below
    the smallest there is."""
    to_deg: float | None = None
    """Largest angle allowed; default: 30 above the largest there is."""
    candidate_step_deg: Positive = 10.0
    """Distance between the angles that are tried."""
    max_from_nearest_deg: Positive = 15.0
    """Largest angle to the nearest image, those added before included: beyond it few matches are
    found."""
