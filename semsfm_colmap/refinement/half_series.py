"""The series cut in two, odd and even images: two models that share no observation.

Each half is adjusted by itself, and its widest pair of images compared with the same pair of the
whole: ``d = range (angle_half / angle_whole - 1)``. What the halves disagree on is noise and drift;
what both err in together, shading above all, this check cannot see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.model_choice import total_rotation, widest_pair
from semsfm_colmap.types import Observations, OrthographicCameras

MIN_IMAGES = 3
"""Fewer in a half have no depth."""


@dataclass(frozen=True, kw_only=True)
class HalfSeries:
    """Changes of the total rotation when half of the images are left out."""

    odd_deg: float
    even_deg: float

    @property
    def difference_deg(self) -> float:
        """Between the halves; about twice the noise of the whole."""
        return self.odd_deg - self.even_deg


def half_series(
    cameras: OrthographicCameras,
    observations: Observations,
    *,
    camera_model: str,
    scale_sigma: float,
    affine_sigma: float,
    sigma_px: float,
    solver: SolverOptions | None = None,
) -> HalfSeries | None:
    """Adjust the odd and the even images alone; None where a half does not stand by itself.

    Parameters
    ----------
    cameras : converged, about 1 px per unit

    """
    M = len(cameras)
    if M < 2 * MIN_IMAGES:
        return None
    whole = np.rad2deg(total_rotation(np.asarray(cameras.cam_from_world)))
    changes = []
    for first in (0, 1):
        mine = np.arange(first, M, 2)
        number = np.full(M, -1, dtype=np.int64)
        number[mine] = np.arange(len(mine))
        local, _ = keep_tracks(
            observations,
            np.ones(len(observations), bool),
            min_length=MIN_IMAGES,
            image_number=number,
        )
        if len(np.unique(local.image_idx)) < len(mine):
            return None
        start = cameras.select(mine)
        fit = bundle_adjust(
            start,
            local,
            camera_model=camera_model,
            scale_sigma=scale_sigma,
            affine_sigma=affine_sigma,
            sigma_px=sigma_px,
            solver=solver,
        )
        assert fit.value is not None
        before = np.asarray(start.cam_from_world)
        after = np.asarray(fit.value[0].cam_from_world)
        a, b = widest_pair(before)
        share = rotation_angle(after[b] @ after[a].T) / rotation_angle(before[b] @ before[a].T)
        changes.append(float(whole * (share - 1.0)))
    return HalfSeries(odd_deg=changes[0], even_deg=changes[1])
