"""How the specimen turned: axis, angle of each image, steps, wobble, closure, the stage's tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.motion.axis import AxisRotation, fit_axis
from semsfm_colmap.motion.check import TiltLine, tilt_line
from semsfm_colmap.motion.prior import MIN_RANGE_DEG
from semsfm_colmap.motion.stage import RotationLine, rotation_line, stage_rotations
from semsfm_colmap.records import TiltAgreement
from semsfm_colmap.report.frames import Frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.types import Float


@dataclass(frozen=True, kw_only=True)
class ClosureMetrics:
    """The step that closes the turn, against the others."""

    is_full_turn: bool
    last_to_first_deg: float
    """about the axis"""
    last_to_first_rotation_deg: float
    """whole angle of the same rotation"""
    median_step_deg: float
    closing_minus_median_step_deg: float | None
    """None unless the turn is full"""


@dataclass(frozen=True, kw_only=True)
class StageTiltMetrics:
    """The line through the angles against the recorded tilts."""

    slope: float
    rms_deg: float
    num_images: int
    agrees: bool | None
    """the judgement of mapping; None where it did not compare them"""
    tolerance: float | None
    """how far from 1 the slope may lie by that judgement"""


@dataclass(frozen=True, kw_only=True)
class RotationMetrics:
    """The motion as a rotation about one axis."""

    axis_camera: tuple[float, ...]
    axis_world: tuple[float, ...]
    axis_in_image_deg: float
    axis_out_of_image_deg: float
    wobble_rms_deg: float
    wobble_max_deg: float
    range_deg: float
    median_step_deg: float
    min_step_deg: float
    max_step_deg: float
    closure: ClosureMetrics
    stage_tilt: StageTiltMetrics | None
    """None where too few tilts are recorded, or they do not differ"""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionColumns:
    """The motion of each registered image, (M,) in acquisition order; nan where not known."""

    angle_deg: Float
    sigma_angle_deg: Float
    step_deg: Float
    wobble_deg: Float
    rotation_from_first_deg: Float
    stage_tilt_deg: Float


def _closure(series: AxisRotation, R: Float) -> ClosureMetrics:
    """The step that closes the turn, against the others.

    Poses relative to one frame always add up to a whole turn, so nothing fails to close; an
    angle scale that is off by a fraction e shows as a closing step that is off by 360 e degrees.
    """
    step_deg = np.rad2deg(series.step_rad)
    closing = float(np.rad2deg(series.closing_step_rad))
    return ClosureMetrics(
        is_full_turn=series.is_full_turn,
        last_to_first_deg=closing,
        last_to_first_rotation_deg=float(np.rad2deg(rotation_angle(R[0] @ R[-1].T))),
        median_step_deg=float(np.median(step_deg)),
        closing_minus_median_step_deg=closing - float(np.median(step_deg))
        if series.is_full_turn
        else None,
    )


def _against_stage_tilt(
    tilt_rad: Float, rotation_rad: Float, angle_rad: Float, R: Float, judged: TiltAgreement | None
) -> StageTiltMetrics | None:
    """The line of the angles over those recorded, and what mapping said of the two.

    Where the stage rotated, too, the angles between views are compared.
    """
    known = np.isfinite(tilt_rad)
    line: TiltLine | RotationLine | None
    turned = known & np.isfinite(rotation_rad)
    if turned.sum() >= 2 and np.ptp(rotation_rad[turned]) >= np.deg2rad(MIN_RANGE_DEG):
        known = turned
        line = rotation_line(stage_rotations(tilt_rad, rotation_rad)[known], R[known])
    else:
        line = tilt_line(tilt_rad[known], angle_rad[known])
    if line is None:
        return None
    compared = judged is not None and judged.factor is not None
    return StageTiltMetrics(
        slope=abs(line.slope),
        rms_deg=float(np.rad2deg(np.sqrt(np.mean(line.residual_rad**2)))),
        num_images=int(known.sum()),
        agrees=judged.consistent if judged is not None and compared else None,
        tolerance=judged.tolerance if judged is not None and compared else None,
    )


def stage_tilt_rad(inputs: ReportInputs, frames: Frames) -> Float:
    """(M,) recorded tilt of the registered images, nan where there is none."""
    tilt = {frame.name: frame.metadata.tilt_rad for frame in inputs.series.frames}
    values = [tilt.get(frames.names[k]) for k in frames.registered]
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)


def stage_rotation_rad(inputs: ReportInputs, frames: Frames) -> Float:
    """(M,) recorded rotation of the stage of the registered images, nan where there is none."""
    names = [frames.names[k] for k in frames.registered]
    return inputs.series.recorded("stage_rotation_rad", names)


def motion_statistics(
    inputs: ReportInputs, frames: Frames
) -> tuple[RotationMetrics | None, MotionColumns]:
    """The motion as a whole, and that of each image.

    No whole where nothing turns, nor of merged series, which turn about axes of their own.
    """
    rec = inputs.reconstruction
    R = rec.cameras.cam_from_world[frames.image_idx]
    tilt = stage_tilt_rad(inputs, frames)
    nothing = np.full(len(R), np.nan)
    from_first = np.rad2deg(rotation_angle(R @ R[0].T)) if len(R) else nothing
    series = fit_axis(R) if len(inputs.series.series_names) == 1 else None
    if series is None:
        return None, MotionColumns(
            angle_deg=nothing,
            sigma_angle_deg=nothing,
            step_deg=nothing,
            wobble_deg=nothing,
            rotation_from_first_deg=from_first,
            stage_tilt_deg=np.rad2deg(tilt),
        )
    axis, wobble = series.axis_camera, np.rad2deg(series.wobble_rad)
    step = np.rad2deg(series.step_rad)
    sigma = nothing
    if rec.sigma_rotation_rad is not None:
        along = np.linalg.norm(rec.sigma_rotation_rad[frames.image_idx] * axis, axis=1)
        sigma = np.rad2deg(along)
    columns = MotionColumns(
        angle_deg=np.rad2deg(series.angle_rad),
        sigma_angle_deg=sigma,
        step_deg=np.concatenate([[np.nan], step]),
        wobble_deg=wobble,
        rotation_from_first_deg=from_first,
        stage_tilt_deg=np.rad2deg(tilt),
    )
    return RotationMetrics(
        axis_camera=tuple(axis.tolist()),
        axis_world=tuple(series.axis_world.tolist()),
        axis_in_image_deg=float(np.rad2deg(np.arctan2(axis[1], axis[0]))),
        axis_out_of_image_deg=float(np.rad2deg(np.arcsin(np.clip(axis[2], -1.0, 1.0)))),
        wobble_rms_deg=float(np.sqrt(np.mean(wobble**2))),
        wobble_max_deg=float(wobble.max()),
        range_deg=float(np.rad2deg(series.range_rad)),
        median_step_deg=float(np.median(step)),
        min_step_deg=float(step.min()),
        max_step_deg=float(step.max()),
        closure=_closure(series, R),
        stage_tilt=_against_stage_tilt(
            tilt, stage_rotation_rad(inputs, frames), series.angle_rad, R, inputs.tilt
        ),
    ), columns
