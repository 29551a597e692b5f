"""One row for each image given: its matches, and where it has a pose its residuals and motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.report.frames import Frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.match_statistics import FrameMatches, matches_per_frame
from semsfm_colmap.report.motion_statistics import MotionColumns
from semsfm_colmap.types import Array, Float, Reconstruction


@dataclass(frozen=True, kw_only=True)
class PoseMetrics:
    """What is known of a registered image."""

    angle_deg: float | None
    """about the fitted axis, relative to the first registered image"""
    sigma_angle_deg: float | None
    step_deg: float | None
    """from the registered image before"""
    wobble_deg: float | None
    rotation_from_first_deg: float | None
    stage_tilt_deg: float | None
    num_observations: int
    num_rejected_observations: int
    rms_px: float | None
    """residual per coordinate"""
    scale_px_per_world: float
    relative_scale: float
    """over the median of all images"""
    sigma_relative_scale: float | None
    sigma_rotation_deg: tuple[float, ...] | None
    """about the camera's x, y, z"""
    sigma_translation_px: tuple[float, ...] | None


@dataclass(frozen=True, kw_only=True)
class ImageMetrics:
    """One image of the series."""

    frame: int
    """from 1, in the order of acquisition"""
    name: str
    matches: FrameMatches
    pose: PoseMetrics | None
    """None where the image could not be registered"""


def _known(values: Float) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _rows(values: Array | None, frames: Frames) -> list[tuple[float, ...] | None]:
    """The rows of an optional per-image array (M, D) in frame order."""
    if values is None:
        return [None] * len(frames.image_idx)
    return [tuple(row) for row in values[frames.image_idx].tolist()]


def relative_scale(rec: Reconstruction, frames: Frames) -> Float:
    """(M,) magnification of the registered images over their median."""
    scale = rec.cameras.scale_px_per_unit[frames.image_idx]
    return scale / np.median(scale) if len(scale) else scale


def _poses(
    inputs: ReportInputs, frames: Frames, residual: Float, motion: MotionColumns
) -> list[PoseMetrics]:
    """The registered images, M of them, in acquisition order."""
    rec = inputs.reconstruction
    num = rec.num_images
    idx, kept = rec.observations.image_idx, rec.inlier
    count = np.bincount(idx[kept], minlength=num)[frames.image_idx]
    total = np.bincount(idx, minlength=num)[frames.image_idx]
    square = np.bincount(idx[kept], weights=np.sum(residual[kept] ** 2, axis=1), minlength=num)
    rms = _known(np.sqrt(square[frames.image_idx] / np.where(count > 0, 2.0 * count, np.nan)))
    scale = rec.cameras.scale_px_per_unit[frames.image_idx]
    relative = relative_scale(rec, frames)
    sigma_scale = np.full(num, np.nan) if rec.sigma_scale is None else rec.sigma_scale
    sigma_relative = _known(sigma_scale[frames.image_idx])
    rotation = None if rec.sigma_rotation_rad is None else np.rad2deg(rec.sigma_rotation_rad)
    sigma_rotation = _rows(rotation, frames)
    sigma_translation = _rows(rec.sigma_translation_px, frames)
    angle, sigma_angle = _known(motion.angle_deg), _known(motion.sigma_angle_deg)
    step, wobble = _known(motion.step_deg), _known(motion.wobble_deg)
    from_first, tilt = _known(motion.rotation_from_first_deg), _known(motion.stage_tilt_deg)
    return [
        PoseMetrics(
            angle_deg=angle[m],
            sigma_angle_deg=sigma_angle[m],
            step_deg=step[m],
            wobble_deg=wobble[m],
            rotation_from_first_deg=from_first[m],
            stage_tilt_deg=tilt[m],
            num_observations=int(count[m]),
            num_rejected_observations=int(total[m] - count[m]),
            rms_px=rms[m],
            scale_px_per_world=float(scale[m]),
            relative_scale=float(relative[m]),
            sigma_relative_scale=sigma_relative[m],
            sigma_rotation_deg=sigma_rotation[m],
            sigma_translation_px=sigma_translation[m],
        )
        for m in range(num)
    ]


def image_statistics(
    inputs: ReportInputs, frames: Frames, residual: Float, motion: MotionColumns
) -> tuple[ImageMetrics, ...]:
    """One row for each of the F images given, registered or not.

    Parameters
    ----------
    residual : (O, 2) px, of all observations
    motion : of the registered images

    """
    poses = dict(
        zip(frames.registered.tolist(), _poses(inputs, frames, residual, motion), strict=True)
    )
    matches = matches_per_frame(inputs.pairs, frames.names)
    return tuple(
        ImageMetrics(frame=k + 1, name=name, matches=matches[k], pose=poses.get(k))
        for k, name in enumerate(frames.names)
    )
