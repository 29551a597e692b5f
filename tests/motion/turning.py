"""Cameras of a specimen that turns about an oblique axis, and priors of its tilts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from semsfm_colmap.motion.prior import TiltPrior

TILTS = np.arange(-30.0, 31.0, 5.0)
AXIS_SEEN_DEG = float(np.degrees(np.arctan2(0.2, 0.97)))
"""Of `cameras`."""


def cameras(
    angles_deg: np.ndarray, noise_deg: float = 0.0, *, reversed_: bool = False
) -> np.ndarray:
    """Rotations about one oblique axis, seen from an arbitrary world frame."""
    axis = np.array([0.97, 0.2, -0.1])
    axis /= np.linalg.norm(axis)
    rng = np.random.default_rng(0)
    angles = np.radians(np.asarray(angles_deg) + noise_deg * rng.normal(size=len(angles_deg)))
    world = Rotation.from_rotvec([0.3, -1.0, 0.5])
    R = (Rotation.from_rotvec(angles[:, None] * axis) * world).as_matrix()
    if reversed_:
        D = np.diag([1.0, 1.0, -1.0])
        R = D @ R @ D
    return R


def prior_of(
    tilts_deg: Sequence[float] | np.ndarray,
    sigma_deg: float = 0.2,
    axis_deg: float | None = None,
) -> TiltPrior:
    """Known tilts of images 0.tif, 1.tif, ...; nan where nothing is known."""
    return TiltPrior(
        image_names=tuple(f"{i}.tif" for i in range(len(tilts_deg))),
        angle_rad=np.radians(np.asarray(tilts_deg, dtype=np.float64)),
        sigma_rad=np.full(len(tilts_deg), np.radians(sigma_deg)),
        axis_image_rad=None if axis_deg is None else float(np.radians(axis_deg)),
        source="table s.csv",
    )
