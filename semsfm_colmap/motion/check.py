"""Known tilts against the angles that the images show: the one comparison, and what it says.

The angle of each camera about the axis of the series (`motion.axis`) is regressed on the known one.
A slope away from 1 means that either is wrong; how far from 1 depends on the range of tilt and on
the standard deviation of the known tilts (`motion.small_tilt`). The mapping stage judges, and the
report carries its judgement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry import losses
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.motion.axis import AxisRotation, fit_axis
from semsfm_colmap.motion.prior import MIN_RANGE_DEG, TiltPrior, known_tilts
from semsfm_colmap.motion.readout import fit_readout, follow_readout
from semsfm_colmap.motion.small_tilt import MAX_DRIFT, tilt_error, tilt_tolerance
from semsfm_colmap.motion.stage import known_rotations, rotation_line
from semsfm_colmap.types import Bool, Float

MIN_TILTS = 3
"""A line through fewer points says nothing about their scatter."""
AXIS_TOLERANCE_DEG = 5.0
"""A stage's axis is aligned with the scan to a few degrees, and often read by eye."""
MAX_ROUGHNESS = 4.0
"""Scatter about the line, in standard deviations of the prior, above which frames are named."""


MAX_SCATTER = 0.1
"""Share of the rotation by which views may lie off tilt and rotation of the stage; beyond, the
record is not of this series, or there is more to the stage."""
MAX_DEPARTURE = 0.02
"""Share of the rotation by which displacements may depart from proportion: belts and stages are
straight to one or two percent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltLine:
    """``seen = slope known + offset`` over the images whose tilt is known."""

    slope: float
    """Estimated over known tilt; its sign is that of the axis."""
    residual_rad: Float
    """(K,) seen minus line"""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltCheck:
    """How a reconstruction agrees with a tilt prior."""

    consistent: bool
    factor: float = math.nan
    """Estimated over known tilt, from the regression; its sign is that of the axis."""
    tolerance: float = math.nan
    """How far from 1 its size may lie."""
    factor_sigma: float = math.nan
    """One standard deviation that the known tilts leave to the factor."""
    outliers: tuple[str, ...] = ()
    """Images whose tilt does not fit the others."""
    message: str


def check_tilt(prior: TiltPrior, image_names: Sequence[str], cam_from_world: Float) -> TiltCheck:
    """Compare estimated rotations (M, 3, 3), in acquisition order, with the known tilts."""
    known, sigma = known_tilts(prior, image_names)
    rotations = known_rotations(prior, image_names)
    if rotations is not None:
        return _check_rotations(prior, image_names, rotations, sigma, cam_from_world)
    rows = np.isfinite(known)
    axis = fit_axis(cam_from_world)
    axis_note = _axis_note(prior, axis)
    seen = np.zeros(len(known)) if axis is None else np.array(axis.angle_rad)
    # images in no order have their whole turns by the known tilts, not by the image before
    seen[rows] = follow_readout(seen[rows], known[rows])
    line = tilt_line(known[rows], seen[rows])
    if line is None:
        notes = (_why_no_line(prior, rows), axis_note)
        return TiltCheck(consistent=True, message="; ".join(part for part in notes if part))
    known, sigma, seen = known[rows], sigma[rows], seen[rows]
    range_rad = float(np.ptp(seen))
    factor_sigma = float(np.median(sigma)) / math.sqrt(float(((known - known.mean()) ** 2).sum()))
    tolerance = tilt_tolerance(range_rad, factor_sigma)
    consistent = abs(abs(line.slope) - 1) <= tolerance
    off = np.abs(line.residual_rad)
    limit = np.maximum(MAX_ROUGHNESS * sigma, 3 * MAD_TO_SIGMA * float(np.median(off)))
    outliers = tuple(image_names[k] for k in np.flatnonzero(rows)[off > limit])
    if consistent:
        message = (
            f"the estimated tilt is {abs(line.slope):.3f} times the known one, within the "
            f"{100 * tolerance:.0f} % that can be told from {math.degrees(range_rad):.0f} degrees"
        )
    else:
        message = _contradiction(prior, known, range_rad, line.slope)
    if outliers:
        message += f"; the tilt of {abbreviate(outliers)} does not fit the others"
    if axis_note:
        message += f"; {axis_note}"
    return TiltCheck(
        consistent=consistent, factor=line.slope, tolerance=tolerance, factor_sigma=factor_sigma,
        outliers=outliers, message=message,
    )  # fmt: skip


def _check_rotations(
    prior: TiltPrior, image_names: Sequence[str], known: Float, sigma_rad: Float, seen: Float
) -> TiltCheck:
    """Compare with tilt and rotation of the stage together."""
    rows = np.flatnonzero(np.isfinite(known).all(axis=(1, 2)))
    line = rotation_line(known[rows], np.asarray(seen)[rows])
    if line is None:
        there = np.isin(np.arange(len(known)), rows)
        return TiltCheck(consistent=True, message=_why_no_line(prior, there))
    factor_sigma = float(np.median(sigma_rad[rows])) / line.leverage_rad
    tolerance = tilt_tolerance(line.seen_range_rad, factor_sigma)
    off = line.residual_rad
    limit = np.maximum(MAX_ROUGHNESS * sigma_rad[rows], 3 * MAD_TO_SIGMA * float(np.median(off)))
    outliers = tuple(image_names[k] for k in rows[off > limit])
    scattered = float(np.median(off)) > MAX_SCATTER * line.seen_range_rad
    consistent = abs(line.slope - 1) <= tolerance and not scattered
    degrees = math.degrees(line.seen_range_rad)
    if consistent:
        message = (
            f"the estimated rotation is {line.slope:.3f} times that of the stage's tilt and "
            f"rotation together, within the {100 * tolerance:.0f} % that can be told from "
            f"{degrees:.0f} degrees"
        )
    else:
        message = (
            f"the tilts and rotations of the stage ({prior.source}) turn the specimen by up to "
            f"{math.degrees(line.known_range_rad):.1f} degrees, but the images show {degrees:.1f}"
            + (", and between other views" if scattered else "")
            + ": check the recorded tilts and rotations; they are not obeyed"
        )
    if outliers and consistent:
        message += f"; the tilt or rotation of {abbreviate(outliers)} does not fit the others"
    return TiltCheck(
        consistent=consistent, factor=line.slope, tolerance=tolerance, factor_sigma=factor_sigma,
        outliers=outliers, message=message,
    )  # fmt: skip


def tilt_line(known_rad: Float, seen_rad: Float) -> TiltLine | None:
    """A line by iteratively reweighted least squares (Huber), so that no single entry bends it.

    None for fewer than three images, or where the known tilts hardly differ.

    Parameters
    ----------
    known_rad, seen_rad : (K,) of the images whose tilt is known

    """
    x, y = known_rad, seen_rad
    if len(x) < MIN_TILTS or float(np.ptp(x)) < math.radians(MIN_RANGE_DEG):
        return None
    weight = np.ones(len(x))
    slope, offset = 0.0, 0.0
    for _ in range(20):
        mx, my = np.average(x, weights=weight), np.average(y, weights=weight)
        slope = float(np.sum(weight * (x - mx) * (y - my)) / np.sum(weight * (x - mx) ** 2))
        offset = float(my - slope * mx)
        residual = y - slope * x - offset
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-9)
        weight = losses.weight("huber", (residual / scale) ** 2, losses.HUBER_TUNING)
    return TiltLine(slope=slope, residual_rad=y - slope * x - offset)


def check_displacements(
    displacement_um: Float, image_names: Sequence[str], cam_from_world: Float
) -> str | None:
    """A sentence on whether displacements (M,) are in proportion to the estimated rotations.

    None where too few are known, they do not differ, or nothing turns.

    Parameters
    ----------
    displacement_um : nan where nothing was recorded

    """
    axis = fit_axis(cam_from_world)
    known = np.flatnonzero(np.isfinite(displacement_um))
    if axis is None:
        return None
    x = displacement_um[known]
    line = fit_readout(x, follow_readout(axis.angle_rad[known], x))
    if line is None:
        return None
    turned = abs(line.slope) * float(np.ptp(x))
    scatter, bend = math.degrees(line.scatter_rad), math.degrees(line.bend_rad)
    outliers = tuple(image_names[k] for k in known[line.outlier])
    named = f"; that of {abbreviate(outliers)} does not fit the others" if outliers else ""
    if line.scatter_rad > MAX_DEPARTURE * turned:
        return (
            f"the displacements do not follow the rotation: about {scatter:.1f} degrees off in "
            f"{math.degrees(turned):.0f}: check the table; they are not obeyed{named}"
        )
    if not line.is_straight and abs(line.bend_rad) > MAX_DEPARTURE * turned:
        return (
            f"the displacements are not in proportion to the rotation, which departs by {bend:.1f} "
            f"degrees in {math.degrees(turned):.0f} from a straight line; they are not obeyed"
            f"{named}"
        )
    return (
        f"the displacements follow the rotation: {abs(math.degrees(line.slope)):.4g} degrees per "
        f"um, {scatter:.2f} degrees off a straight line{named}"
    )


def _why_no_line(prior: TiltPrior, rows: Bool) -> str:
    """Why nothing was compared; empty where only the axis is known."""
    if not np.isfinite(prior.angle_rad).any():
        return ""
    if rows.sum() < MIN_TILTS:
        return "fewer than three images have both a known and an estimated tilt"
    return "the known tilts of the registered images do not differ"


def _contradiction(prior: TiltPrior, known: Float, range_rad: float, slope: float) -> str:
    """That known and seen tilt disagree, and what may be the cause."""
    message = (
        f"the known tilts ({prior.source}) span {math.degrees(float(np.ptp(known))):.1f} "
        f"degrees, but the images show {math.degrees(range_rad):.1f}: check the recorded tilts "
        "or the step; they are not obeyed"
    )
    if abs(abs(slope) - 1) <= tilt_error(range_rad, MAX_DRIFT):
        message += (
            f" (a change of the magnification by {MAX_DRIFT:.1%} between the images would "
            "explain it, too)"
        )
    return message


def _axis_note(prior: TiltPrior, axis: AxisRotation | None) -> str:
    """How the axis seen in the images lies to the known one; empty where none is known."""
    if prior.axis_image_rad is None or axis is None:
        return ""
    seen = math.degrees(math.atan2(axis.axis_camera[1], axis.axis_camera[0]))
    said = math.degrees(prior.axis_image_rad)
    apart = abs((seen - said + 90.0) % 180.0 - 90.0)
    seen = (seen + 45.0) % 180.0 - 45.0
    if apart <= AXIS_TOLERANCE_DEG:
        return f"the tilt axis lies at {seen:.1f} degrees in the images, as said"
    return (
        f"the tilt axis lies at {seen:.1f} degrees in the images, from x toward y, and not at "
        f"{said:.1f}, as option or header say: the images are believed; check the order of the "
        "images, or whether they were turned"
    )
