"""What is known about the tilt before anything is computed: a prior, never a command.

A stage, a table or a nominal step give an angle per image. Stages have an unknown zero and some
backlash, so only differences count, each with a standard deviation; whether the numbers are right
at all is checked against the reconstruction (`check_tilt`): the angle of each camera about the
common axis is regressed on the known one, and a slope away from 1 means that either is wrong. How
far from 1 depends on the range of tilt (`geometry.tilt`).

Where they agree, the common factor of all angles is the weighted mean of what the images say and
what is known (`combine_tilt`). The weight of the images is not their formal error, which thousands
of features make tiny, but what their angles were seen to be wrong by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.motion.small_tilt import MAX_DRIFT, tilt_error, tilt_tolerance
from semsfm_colmap.types import Float

MIN_RANGE_DEG = 0.5
"""Tilts that vary less say that the specimen was not turned by the stage."""
AXIS_TOLERANCE_DEG = 5.0
"""A stage's axis is aligned with the scan to a few degrees, and often read by eye."""
MAX_ROUGHNESS = 4.0
"""Scatter about the line, in standard deviations of the prior, above which frames are named."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltPrior:
    """Known tilts: only their differences count; nan where nothing is known."""

    image_names: tuple[str, ...]
    angle_rad: Float
    """(M,) about one axis common to all images"""
    sigma_rad: Float
    """(M,)"""
    axis_image_rad: float | None
    """Direction of the axis in the images, from x toward y; None = to be estimated."""
    source: str

    @property
    def range_rad(self) -> float:
        """Largest minus smallest known angle."""
        return float(np.nanmax(self.angle_rad) - np.nanmin(self.angle_rad))


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltCheck:
    """How a reconstruction agrees with a tilt prior."""

    consistent: bool
    factor: float
    """Estimated over known tilt, from the regression; its sign is that of the axis."""
    tolerance: float
    factor_sigma: float
    """One standard deviation that the known tilts leave to the factor."""
    scatter_rad: float
    """RMS about the regression line."""
    outliers: tuple[str, ...]
    message: str


def check_tilt(prior: TiltPrior, image_names: Sequence[str], cam_from_world: Float) -> TiltCheck:
    """Compare estimated rotations (M, 3, 3) with the known tilts."""
    index = {name: i for i, name in enumerate(prior.image_names)}
    rows = [
        (index[name], i)
        for i, name in enumerate(image_names)
        if name in index and np.isfinite(prior.angle_rad[index[name]])
    ]
    axis = _axis_note(prior, cam_from_world)
    known = prior.angle_rad[[a for a, _ in rows]]
    if len(rows) < 3 or float(np.ptp(known)) < math.radians(MIN_RANGE_DEG):
        few = "the known tilts of the registered images do not differ"
        if len(rows) < 3:
            few = "fewer than three images have both a known and an estimated tilt"
        if not np.isfinite(prior.angle_rad).any():
            few = ""
        return TiltCheck(
            consistent=True, factor=math.nan, tolerance=math.nan, factor_sigma=math.nan,
            scatter_rad=math.nan, outliers=(),
            message="; ".join(part for part in (few, axis) if part),
        )  # fmt: skip
    sigma = prior.sigma_rad[[a for a, _ in rows]]
    estimated = angles_about_common_axis(cam_from_world[[b for _, b in rows]])
    factor, residual = _robust_line(known, estimated)
    range_rad = float(np.ptp(estimated))
    factor_sigma = float(np.median(sigma)) / math.sqrt(float(((known - known.mean()) ** 2).sum()))
    tolerance = tilt_tolerance(range_rad, factor_sigma)
    consistent = abs(abs(factor) - 1) <= tolerance
    scatter = float(np.sqrt(np.mean(residual**2)))
    limit = np.maximum(MAX_ROUGHNESS * sigma, 3 * 1.4826 * float(np.median(np.abs(residual))))
    outliers = tuple(
        prior.image_names[a]
        for (a, _), bad in zip(rows, np.abs(residual) > limit, strict=True)
        if bad
    )
    if consistent:
        message = (
            f"the estimated tilt is {abs(factor):.3f} times the known one, within the "
            f"{100 * tolerance:.0f} % that can be told from {math.degrees(range_rad):.0f} degrees"
        )
    else:
        message = (
            f"the known tilts ({prior.source}) span {math.degrees(float(np.ptp(known))):.1f} "
            f"degrees, but the images show {math.degrees(range_rad):.1f}: check the recorded tilts "
            "or the step; they are not obeyed"
        )
        if abs(abs(factor) - 1) <= tilt_error(range_rad, MAX_DRIFT):
            message += (
                f" (a change of the magnification by {MAX_DRIFT:.1%} between the images would "
                "explain it, too)"
            )
    if outliers:
        message += f"; the tilt of {abbreviate(outliers)} does not fit the others"
    if axis:
        message += f"; {axis}"
    return TiltCheck(
        consistent=consistent, factor=factor, tolerance=tolerance, factor_sigma=factor_sigma,
        scatter_rad=scatter, outliers=outliers, message=message,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CombinedTilt:
    """What images and knowledge say together about the common factor of all angles."""

    stretch: float
    """To multiply the angles estimated from the images alone with."""
    weight: float
    """Of the known tilts, in 0 to 1."""
    sigma: float
    """One relative standard deviation of the angles after that."""


def combine_tilt(check: TiltCheck, range_rad: float, range_sigma_rad: float) -> CombinedTilt:
    """The mean of the estimated and the known angles, weighted by their variances.

    Parameters
    ----------
    check : of a prior that the images do not contradict, with a factor
    range_rad, range_sigma_rad : largest rotation between two images, and its formal error

    """
    images = math.hypot(range_sigma_rad / range_rad, tilt_error(range_rad))
    weight = images**2 / (images**2 + check.factor_sigma**2)
    return CombinedTilt(
        stretch=abs(check.factor) ** -weight,
        weight=weight,
        sigma=images * check.factor_sigma / math.hypot(images, check.factor_sigma),
    )


def angles_about_common_axis(cam_from_world: Float) -> Float:
    """Angle (M,) of each camera about the axis that explains most of the rotations.

    The rotations relative to the middle camera, as vectors, lie along the axis; the first principal
    direction of these vectors is the axis, and the angle is the projection on it.
    """
    vectors, axis = _common_axis(cam_from_world)
    return np.unwrap(np.asarray(vectors @ axis))


def _common_axis(cam_from_world: Float) -> tuple[Float, Float]:
    """Rotation vectors (M, 3) from the middle camera, in its frame, and their direction (3,)."""
    from scipy.spatial.transform import Rotation

    middle = len(cam_from_world) // 2
    relative = cam_from_world @ cam_from_world[middle].T
    vectors = Rotation.from_matrix(relative).as_rotvec()
    return vectors, np.linalg.svd(vectors)[2][0]


def _axis_note(prior: TiltPrior, cam_from_world: Float) -> str:
    """How the axis seen in the images lies to the known one; empty where none is known."""
    if prior.axis_image_rad is None or len(cam_from_world) < 2:
        return ""
    _, axis = _common_axis(cam_from_world)
    seen = math.degrees(math.atan2(axis[1], axis[0]))
    said = math.degrees(prior.axis_image_rad)
    apart = abs((seen - said + 90.0) % 180.0 - 90.0)
    seen = (seen + 45.0) % 180.0 - 45.0
    if apart <= AXIS_TOLERANCE_DEG:
        return f"the tilt axis lies at {seen:.1f} degrees in the images, as said"
    return (
        f"the tilt axis lies at {seen:.1f} degrees in the images, from x toward y, and not at "
        f"{said:.1f} (option tilt_axis): the images are believed; check the order of the images, "
        "or whether they were turned"
    )


def _robust_line(x: Float, y: Float) -> tuple[float, Float]:
    """Slope and residuals of a line by iteratively reweighted least squares (Huber)."""
    weight = np.ones(len(x))
    slope, offset = 0.0, 0.0
    for _ in range(20):
        mx, my = np.average(x, weights=weight), np.average(y, weights=weight)
        slope = float(np.sum(weight * (x - mx) * (y - my)) / np.sum(weight * (x - mx) ** 2))
        offset = float(my - slope * mx)
        residual = y - slope * x - offset
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-9)
        weight = np.minimum(1.0, 1.345 * scale / np.maximum(np.abs(residual), 1e-12))
    return slope, y - slope * x - offset
