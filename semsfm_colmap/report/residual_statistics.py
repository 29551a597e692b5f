"""Residuals in px and nm, and the noise of the measurements that they speak for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.types import Float, Reconstruction


@dataclass(frozen=True, kw_only=True)
class AxisResiduals:
    """Residuals along one axis of the images."""

    mean_px: float
    sigma_px: float
    robust_sigma_px: float
    """from the median absolute deviation"""
    mean_nm: float | None
    sigma_nm: float | None


@dataclass(frozen=True, kw_only=True)
class ResidualMetrics:
    """Residuals of the kept observations; nm where the pixel size is known."""

    num_residuals: int
    x: AxisResiduals
    y: AxisResiduals
    rms_per_coordinate_px: float
    rms_per_coordinate_nm: float | None
    noise_sigma_px: float | None
    """noise of one measured coordinate; None where the fit leaves no freedom"""
    noise_sigma_nm: float | None
    median_error_px: float
    p95_error_px: float
    max_error_px: float


def noise_sigma(reconstruction: Reconstruction, residual: Float) -> float | None:
    """Standard deviation of one measured coordinate, in px.

    Fitting takes up part of the noise: three unknowns a point, five an image (six when its
    magnification is free), less the gauge that no image sees (rotation, translation, and scale
    when it is free). ``sigma^2 = sum r^2 / (2 O - unknowns)`` undoes that. Points with fewer than
    two observations carry no information and are left out.
    """
    rec = reconstruction
    track = rec.observations.track_idx
    used = rec.inlier & (rec.track_length()[track] >= 2)
    num_cameras = len(np.unique(rec.observations.image_idx[used]))
    free_scale = rec.camera_model != "orthographic"
    affine = 2 if "affine" in rec.camera_model else 0
    cameras = num_cameras * (6 if free_scale else 5) + affine - (7 if free_scale else 6)
    freedom = 2 * int(used.sum()) - 3 * len(np.unique(track[used])) - cameras
    if freedom <= 0 or num_cameras < 2:
        return None
    return float(np.sqrt(np.sum(residual[used] ** 2) / freedom))


def _along_axis(r: Float, nm_per_px: float | None) -> AxisResiduals:
    """Mean and spread of the residuals (O,) in one coordinate."""
    mean, sigma = float(r.mean()), float(r.std())
    return AxisResiduals(
        mean_px=mean,
        sigma_px=sigma,
        robust_sigma_px=float(MAD_TO_SIGMA * np.median(np.abs(r - np.median(r)))),
        mean_nm=None if nm_per_px is None else mean * nm_per_px,
        sigma_nm=None if nm_per_px is None else sigma * nm_per_px,
    )


def residual_statistics(
    reconstruction: Reconstruction, residual: Float, pixel_size_nm: float | None
) -> ResidualMetrics | None:
    """Mean and spread per axis of the kept observations; None without any.

    `residual` (O, 2) is predicted minus measured in px, of all observations. In y, a pixel is the
    pixel size divided by the aspect.
    """
    kept = residual[reconstruction.inlier]
    if len(kept) == 0:
        return None
    error = np.linalg.norm(kept, axis=1)
    nm = pixel_size_nm
    noise = noise_sigma(reconstruction, residual)
    rms = float(np.sqrt(np.mean(kept**2)))
    return ResidualMetrics(
        num_residuals=len(kept),
        x=_along_axis(kept[:, 0], nm),
        y=_along_axis(kept[:, 1], None if nm is None else nm / reconstruction.cameras.aspect),
        rms_per_coordinate_px=rms,
        rms_per_coordinate_nm=None if nm is None else rms * nm,
        noise_sigma_px=noise,
        noise_sigma_nm=None if noise is None or nm is None else noise * nm,
        median_error_px=float(np.median(error)),
        p95_error_px=float(np.percentile(error, 95)),
        max_error_px=float(error.max()),
    )
