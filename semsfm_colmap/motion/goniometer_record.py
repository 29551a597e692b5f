"""What the goniometer measured, as numbers and sentences for report/goniometer.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.motion.belt import unit_doubt
from semsfm_colmap.motion.goniometer import Goniometer, Readout
from semsfm_colmap.motion.path import SpecimenPath
from semsfm_colmap.motion.readout import BENT_SIGMAS, ReadoutLine
from semsfm_colmap.records import (
    EccentricityFigures,
    Estimate,
    GoniometerImage,
    GoniometerRecord,
    ReadoutFigures,
    StepFigures,
    TurnFigures,
)
from semsfm_colmap.types import Float

RETRACED = 1.5
"""A series whose steps add up to this many times its range goes there and back."""


def goniometer_record(
    found: Goniometer,
    names: Sequence[str],
    displacement: Readout,
    tilt: Readout,
    *,
    model: str,
    displacement_source: str | None,
    pixel_size_um: float | None,
    notes: Sequence[str] = (),
) -> GoniometerRecord:
    """The record of a measured motion.

    Parameters
    ----------
    names : of the images as they were given, as are the read-outs
    model : digest of what it was measured on
    notes : what was found odd before

    """
    series, line = found.series, found.displacement
    in_sequence = [names[k] for k in found.images]
    wobble = np.rad2deg(series.wobble_rad)
    figures = _readout(line, in_sequence, displacement.value[found.images])
    stage = _readout(found.tilt, in_sequence, tilt.value[found.images])
    axis = series.axis_camera
    inside, outside = np.rad2deg(np.sqrt(np.diag(found.axis_covariance_rad2)))
    return GoniometerRecord(
        model=model,
        in_order=found.in_order,
        conversion_deg_per_um=None if line is None else _degrees(line.slope, line.slope_sigma),
        displacement_source=None if line is None else displacement_source,
        displacement=figures,
        tilt_ratio=None
        if found.tilt is None
        else Estimate(value=abs(found.tilt.slope), sigma=found.tilt.slope_sigma),
        tilt=stage,
        axis_camera=tuple(axis.tolist()),
        axis_camera_sigma_deg=float(np.rad2deg(found.axis_sigma_rad)),
        axis_camera_sigmas_deg=(float(inside), float(outside)),
        axis_world=tuple(series.axis_world.tolist()),
        axis_world_sigma_deg=float(np.rad2deg(found.axis_world_sigma_rad)),
        axis_in_image_deg=float(np.rad2deg(np.arctan2(axis[1], axis[0]))),
        axis_out_of_image_deg=float(np.rad2deg(np.arcsin(np.clip(axis[2], -1.0, 1.0)))),
        range_deg=float(np.rad2deg(series.range_rad)),
        wobble_deg_rms=float(np.sqrt(np.mean(wobble**2))),
        steps=_steps(found, in_sequence),
        turn=_turn(found),
        eccentricity=_eccentricity(found.path, pixel_size_um),
        move_unit="px" if pixel_size_um is None else "um",
        images=_images(found, in_sequence, displacement, pixel_size_um),
        order=tuple(names[k] for k in found.order),
        notes=(*notes, *_notes(found, figures, stage)),
    )


def _degrees(value: float, sigma: float) -> Estimate:
    return Estimate(value=float(np.rad2deg(value)), sigma=float(np.rad2deg(sigma)))


def _readout(line: ReadoutLine | None, names: Sequence[str], value: Float) -> ReadoutFigures | None:
    """The figures of a line.

    Parameters
    ----------
    names, value : of all images, nan where nothing was read

    """
    if line is None:
        return None
    known = np.flatnonzero(np.isfinite(value))
    hysteresis = None
    if line.hysteresis_rad is not None and line.hysteresis_sigma_rad is not None:
        hysteresis = _degrees(line.hysteresis_rad, line.hysteresis_sigma_rad)
    return ReadoutFigures(
        hysteresis_deg=hysteresis,
        scatter_deg=float(np.rad2deg(line.scatter_rad)),
        bend_deg=_degrees(line.bend_rad, line.bend_sigma_rad),
        is_straight=line.is_straight,
        outliers=tuple(names[k] for k in known[line.outlier]),
        num_images=len(known),
    )


def _steps(found: Goniometer, names: Sequence[str]) -> StepFigures:
    step = np.rad2deg(found.series.step_rad)
    # a run there and back has steps of both signs and of one size
    size = np.abs(step)
    median = float(np.median(size))
    apart = size - median
    worst = int(np.argmax(np.abs(apart)))
    return StepFigures(
        median_deg=median,
        scatter_deg=MAD_TO_SIGMA * float(np.median(np.abs(apart))),
        largest_departure_deg=float(apart[worst]),
        largest_departure_image=names[worst + 1],
    )


def _turn(found: Goniometer) -> TurnFigures | None:
    """The step that closes one turn, where the images make just one, all one way."""
    series = found.series
    step = float(np.median(series.step_rad))
    one_way = float(np.abs(series.step_rad).sum()) < RETRACED * series.range_rad
    if not series.is_full_turn or not one_way or series.range_rad > 2.0 * np.pi + abs(step):
        return None
    return TurnFigures(
        closing_step_deg=float(np.rad2deg(series.closing_step_rad)),
        minus_median_step_deg=float(np.rad2deg(series.closing_step_rad - step)),
    )


def _eccentricity(path: SpecimenPath, pixel_size_um: float | None) -> EccentricityFigures | None:
    if path.circle is None:
        return None
    px, sigma = path.circle.radius_px, path.circle.sigma_px
    drift, rest = path.circle.drift_px_per_rad, path.circle.axis_shift_px(path.centre_px)
    turn, rms = 2.0 * np.pi * drift, np.sqrt(np.mean(rest**2, axis=0))
    return EccentricityFigures(
        radius_px=Estimate(value=px, sigma=sigma),
        radius_um=None
        if pixel_size_um is None
        else Estimate(value=px * pixel_size_um, sigma=sigma * pixel_size_um),
        drift_px_per_turn=(float(turn[0]), float(turn[1])),
        rest_px_rms=(float(rms[0]), float(rms[1])),
    )


def _images(
    found: Goniometer, names: Sequence[str], displacement: Readout, pixel_size_um: float | None
) -> dict[str, GoniometerImage]:
    angle = np.rad2deg(found.series.angle_rad)
    sigma = None if found.angle_sigma_rad is None else np.rad2deg(found.angle_sigma_rad)
    value = displacement.value[found.images]
    residual = np.full(len(names), np.nan)
    if found.displacement is not None:
        residual[np.isfinite(value)] = np.rad2deg(found.displacement.residual_rad)
    shift, offset = found.path.shift_px, np.rad2deg(found.axis_offset_rad)
    bars = found.axis_offset_sigma_rad
    bars = None if bars is None else np.rad2deg(bars)
    circle = found.path.circle
    unit = pixel_size_um or 1.0
    moves = None if circle is None else unit * circle.moves_px
    return {
        name: GoniometerImage(
            angle_deg=float(angle[k]),
            sigma_deg=None if sigma is None else float(sigma[k]),
            displacement_um=_or_none(value[k]),
            residual_deg=_or_none(residual[k]),
            shift_px=(float(shift[k, 0]), float(shift[k, 1])),
            shift_um=None
            if pixel_size_um is None
            else (float(unit * shift[k, 0]), float(unit * shift[k, 1])),
            axis_offset_deg=(float(offset[k, 0]), float(offset[k, 1])),
            axis_sigma_deg=None if bars is None else (float(bars[k, 0]), float(bars[k, 1])),
            move=None
            if moves is None
            else (float(moves[k, 0]), float(moves[k, 1]), float(moves[k, 2])),
        )
        for k, name in enumerate(names)
    }


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _notes(
    found: Goniometer, figures: ReadoutFigures | None, stage: ReadoutFigures | None
) -> Iterator[str]:
    """What a person should know, one sentence each."""
    line = found.displacement
    if not found.in_order:
        by = "their angles" if line is None else "displacement"
        yield f"the images are not in the order of the rotation; they were put into order by {by}"
    if line is not None and figures is not None:
        doubt = unit_doubt(float(np.rad2deg(line.slope)))
        if doubt:
            yield doubt
        yield from _of_readout(figures, "displacement", "hysteresis")
    if stage is not None:
        yield from _of_readout(stage, "recorded tilt", "backlash")
    if found.angle_sigma_rad is None:
        yield (
            "the model has no error bars: the standard deviations are from the scatter of the "
            "images alone, and what all angles err in together is not in them"
        )
    if found.path.circle is None:
        yield (
            "the rotation is too small, or the images are too few, to tell an eccentric specimen "
            "from a drift: no stage moves are given"
        )


def _of_readout(figures: ReadoutFigures, name: str, lag: str) -> Iterator[str]:
    bend, back = figures.bend_deg, figures.hysteresis_deg
    if not figures.is_straight:
        yield (
            f"the angle is no straight line of the {name}: it is bent by {bend.value:.2f} +- "
            f"{bend.sigma:.2f} degrees over the range"
        )
    if back is not None and abs(back.value) > BENT_SIGMAS * back.sigma:
        yield (
            f"a {lag} of {back.value:.2f} +- {back.sigma:.2f} degrees: angles of a rising "
            f"{name} minus those of a falling one"
        )
    if figures.outliers:
        yield f"the {name} of {abbreviate(figures.outliers)} does not fit the others"
