"""Residuals in px and nm, and the noise of the measurements that they speak for."""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.types import Float, Reconstruction

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation of a Gaussian."""


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


def residual_statistics(
    reconstruction: Reconstruction, residual: Float, pixel_size_nm: float | None
) -> dict[str, Any]:
    """Mean and spread per axis of the kept observations; nm when the pixel size is known.

    `residual` (O, 2) is predicted minus measured in px, of all observations.
    """
    kept = residual[reconstruction.inlier]
    out: dict[str, Any] = {"num_residuals": len(kept)}
    if len(kept) == 0:
        return out
    error = np.linalg.norm(kept, axis=1)
    nm_per_px = (
        (None, None)
        if pixel_size_nm is None
        else (pixel_size_nm, pixel_size_nm / reconstruction.cameras.aspect)
    )
    for axis, nm in zip((0, 1), nm_per_px, strict=True):
        letter, r = "xy"[axis], kept[:, axis]
        mean, sigma = float(r.mean()), float(r.std())
        out[f"mean_{letter}_px"] = mean
        out[f"sigma_{letter}_px"] = sigma
        out[f"robust_sigma_{letter}_px"] = float(MAD_TO_SIGMA * np.median(np.abs(r - np.median(r))))
        out[f"mean_{letter}_nm"] = None if nm is None else mean * nm
        out[f"sigma_{letter}_nm"] = None if nm is None else sigma * nm
    noise = noise_sigma(reconstruction, residual)
    rms = float(np.sqrt(np.mean(kept**2)))
    return out | {
        "rms_per_coordinate_px": rms,
        "rms_per_coordinate_nm": None if pixel_size_nm is None else rms * pixel_size_nm,
        "noise_sigma_px": noise,
        "noise_sigma_nm": None if None in (noise, pixel_size_nm) else noise * pixel_size_nm,  # type: ignore[operator]
        "median_error_px": float(np.median(error)),
        "p95_error_px": float(np.percentile(error, 95)),
        "max_error_px": float(error.max()),
    }
