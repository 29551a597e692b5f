"""The series cut in two, odd and even images: two models that share no observation.

Each half is adjusted by itself, and its widest pair of images compared with the same pair of the
whole: ``d = range (angle_half / angle_whole - 1)``. What the halves disagree on is noise and drift;
what both err in together, shading above all, this check cannot see.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.records import HalfSeries
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.model_choice import total_rotation, widest_pair
from semsfm_colmap.types import Observations, OrthographicCameras

MIN_IMAGES = 3
"""Fewer in a half have no depth."""


def half_series(
    cameras: OrthographicCameras,
    observations: Observations,
    settings: BundleSettings,
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
        local = take_subset(observations, images=mine, min_length=MIN_IMAGES).observations
        if len(np.unique(local.image_idx)) < len(mine):
            return None
        start = cameras.select(mine)
        fit = bundle_adjust(start, local, settings)
        assert fit.value is not None
        before = np.asarray(start.cam_from_world)
        after = np.asarray(fit.value.cameras.cam_from_world)
        a, b = widest_pair(before)
        share = rotation_angle(after[b] @ after[a].T) / rotation_angle(before[b] @ before[a].T)
        changes.append(float(whole * (share - 1.0)))
    odd, even = changes
    return HalfSeries(odd_deg=odd, even_deg=even, difference_deg=odd - even)
