"""How much the result hangs on single images: fits with one image left out.

A formal standard deviation only knows the noise. Leaving an image out shows what one drifted,
charged or mismatched image does to the others; for independent errors the jackknife turns the
changes d_k of n fits into a standard deviation ``sqrt((n - 1) / n sum_k d_k^2)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

MAX_FITS = 10
"""Images left out one at a time; of more, so many are chosen evenly."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LeaveOneOut:
    """Changes of the other images' rotations."""

    images: Int
    """which were left out"""
    change_deg: Float
    """root mean square change of the remaining images' rotations for each"""
    jackknife_deg: float
    """standard deviation of a rotation from the changes, scaled up to all images"""


def leave_one_out(
    cameras: OrthographicCameras,
    observations: Observations,
    settings: BundleSettings,
) -> LeaveOneOut | None:
    """Refit without each of some images; None with fewer than four images."""
    M = len(cameras)
    if M < 4:
        return None
    chosen = np.unique(np.linspace(0, M - 1, min(MAX_FITS, M)).round().astype(np.int64))
    start = cameras
    left_out, changes = [], []
    # the first fit, with all images, is what the others are compared with
    for k in (None, *chosen):
        rest = np.arange(M) if k is None else np.delete(np.arange(M), k)
        local = take_subset(observations, images=rest, min_length=2).observations
        if len(np.unique(local.image_idx)) < len(rest):
            continue
        fit = bundle_adjust(start.select(rest), local, settings)
        assert fit.value is not None
        if k is None:
            start = fit.value.cameras
            continue
        left_out.append(k)
        R = np.asarray(fit.value.cameras.cam_from_world)
        before = np.asarray(start.cam_from_world)[rest]
        Q = align_rotations(R, before)
        angle = rotation_angle(R @ Q @ before.transpose(0, 2, 1))
        changes.append(float(np.rad2deg(np.sqrt(np.mean(angle**2)))))
    if not changes:
        return None
    d = np.array(changes)
    return LeaveOneOut(
        images=np.array(left_out, dtype=np.int64),
        change_deg=d,
        jackknife_deg=float(np.sqrt((M - 1) * np.mean(d**2))),
    )
