"""How the specimen turned: axis, angle of each image, steps, wobble, closure, the stage's tilt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.motion.axis import RotationSeries, fit_rotation_series
from semsfm_colmap.report.frames import Frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.types import Float

MIN_TILTS = 3
"""A line through fewer points says nothing about their scatter."""
MIN_TILT_RANGE_DEG = 1.0
"""A stage reads its tilt to about 0.1 degrees: below this a slope means nothing."""


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


def _closure(series: RotationSeries, R: Float) -> ClosureMetrics:
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


def _against_stage_tilt(tilt_deg: Float, angle_deg: Float) -> dict[str, Any] | None:
    """Fit ``angle = slope tilt + offset`` where the microscope recorded a tilt."""
    known = np.isfinite(tilt_deg)
    tilt, angle = tilt_deg[known], angle_deg[known]
    if len(tilt) < MIN_TILTS or np.ptp(tilt) < MIN_TILT_RANGE_DEG:
        return None
    design = np.stack([tilt, np.ones_like(tilt)], axis=1)
    (slope, offset), *_ = np.linalg.lstsq(design, angle, rcond=None)
    rms = np.sqrt(np.mean((design @ (slope, offset) - angle) ** 2))
    return {"slope": abs(float(slope)), "rms_deg": float(rms), "num_images": len(tilt)}


def stage_tilt_deg(inputs: ReportInputs, frames: Frames) -> Float:
    """(M,) recorded tilt of the registered images, nan where there is none."""
    tilt = {frame.name: frame.metadata.tilt_rad for frame in inputs.series.frames}
    values = [tilt.get(frames.names[k]) for k in frames.registered]
    return np.rad2deg(np.array([np.nan if v is None else v for v in values], dtype=np.float64))


def motion_statistics(
    inputs: ReportInputs, frames: Frames
) -> tuple[RotationMetrics | None, MotionColumns]:
    """The motion as a whole, and that of each image; no whole where nothing turns."""
    rec = inputs.reconstruction
    R = rec.cameras.cam_from_world[frames.image_idx]
    tilt = stage_tilt_deg(inputs, frames)
    nothing = np.full(len(R), np.nan)
    from_first = np.rad2deg(rotation_angle(R @ R[0].T)) if len(R) else nothing
    series = fit_rotation_series(R)
    if series is None:
        return None, MotionColumns(
            angle_deg=nothing,
            sigma_angle_deg=nothing,
            step_deg=nothing,
            wobble_deg=nothing,
            rotation_from_first_deg=from_first,
            stage_tilt_deg=tilt,
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
        stage_tilt_deg=tilt,
    )
    line = _against_stage_tilt(tilt, columns.angle_deg)
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
        stage_tilt=None if line is None else StageTiltMetrics(**line),
    ), columns
