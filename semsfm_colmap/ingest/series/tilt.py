"""Known tilts of a prepared series, from the files, a table or a nominal step, as a prior."""

from __future__ import annotations

import math

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.motion.prior import MIN_RANGE_DEG, TiltPrior
from semsfm_colmap.types import Float, SemSeries

SIGMA_TABLE_DEG = 0.2
SIGMA_STAGE_DEG = 0.5
"""Repeatability of SEM stages, with backlash; data sheets say 0.1 to 0.5."""
SIGMA_STEP_PART = 0.1


def tilt_prior(series: SemSeries, options: IngestOptions) -> TiltPrior | None:
    """The prior of a prepared series, or None if no tilt is known or it does not vary.

    Where only the axis is known, the prior holds no angles.
    """
    axis = parse_axis(options.tilt_axis)
    if axis is None:
        axis = recorded_axis(series)
    angles = series.recorded("tilt_rad")
    sources = {f.metadata.source.get("tilt_rad", "") for f in series.frames}
    from_table = any(source.startswith("table ") for source in sources)
    rotation = recorded_rotation(series)
    known = np.isfinite(angles) & (np.isfinite(rotation) if rotation is not None else True)
    displacement = recorded_displacements(series)
    varies = known.sum() >= 2 and np.ptp(angles[known]) >= math.radians(MIN_RANGE_DEG)
    if varies or rotation is not None:
        default = SIGMA_TABLE_DEG if from_table else SIGMA_STAGE_DEG
        source = "; ".join(sorted(s for s in sources if s))
    elif options.degrees_per_um is not None and displacement is not None:
        angles = math.radians(options.degrees_per_um) * displacement
        default, source = SIGMA_TABLE_DEG, "displacements times degrees_per_um"
    elif options.tilt_step_deg is not None:
        angles = math.radians(options.tilt_step_deg) * np.arange(len(series.frames), dtype=float)
        default = SIGMA_STEP_PART * abs(options.tilt_step_deg)
        source = "option tilt_step_deg"
    elif axis is not None:
        angles, default, source = np.full(len(series.frames), np.nan), SIGMA_STAGE_DEG, "none"
    else:
        return None
    sigma_deg = options.tilt_sigma_deg if options.tilt_sigma_deg is not None else default
    if not (math.isfinite(sigma_deg) and sigma_deg > 0):
        raise UsageError(f"tilt_sigma_deg = {sigma_deg} but expected a positive number.")
    return TiltPrior(
        image_names=series.names,
        angle_rad=angles,
        sigma_rad=np.full(len(angles), math.radians(sigma_deg)),
        axis_image_rad=axis,
        source=source,
        rotation_rad=rotation,
    )


def recorded_rotation(series: SemSeries) -> Float | None:
    """(M,) of the stage about its normal; None where it does not vary, or the tilt is not known.

    Without tilt such a rotation turns the images in their plane, and shows nothing more.
    """
    tilt, rotation = series.recorded("tilt_rad"), series.recorded("stage_rotation_rad")
    known = np.isfinite(tilt) & np.isfinite(rotation)
    if known.sum() < 2:
        return None
    turned = np.abs((rotation[known] - rotation[known][0] + np.pi) % (2 * np.pi) - np.pi)
    if turned.max() < math.radians(MIN_RANGE_DEG):
        return None
    tilted = np.abs(tilt[known]).max() >= math.radians(MIN_RANGE_DEG)
    return rotation if tilted else None


def recorded_displacements(series: SemSeries) -> Float | None:
    """(M,) of the actuator in um, nan where none is recorded; None where they do not differ."""
    said = series.recorded("displacement_um")
    return said if len(np.unique(said[np.isfinite(said)])) >= 2 else None


def recorded_axis(series: SemSeries) -> float | None:
    """The tilt axis that the first image with one records."""
    recorded = (frame.metadata.tilt_axis_rad for frame in series.frames)
    return next((axis for axis in recorded if axis is not None), None)


def parse_axis(text: str) -> float | None:
    """``auto`` -> None, ``x`` -> 0, ``y`` -> pi / 2, a number of degrees -> radians."""
    word = text.strip().lower()
    if word in ("auto", ""):
        return None
    if word in ("x", "y"):
        return 0.0 if word == "x" else math.pi / 2
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"tilt_axis = {text!r} but expected auto, x, y or degrees.")
    return math.radians(value)
