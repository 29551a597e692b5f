"""Comparing estimated with true rotations in tests, without the package's own alignment."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.rotations import depth_reversed, nearest_rotation, rotation_angle
from semsfm_colmap.types import Float


def rotation_errors_deg(R: Float, R_true: Float) -> Float:
    """Angles left after the best common world rotation: (M, 3, 3) x 2 -> (M,) deg."""
    Q = nearest_rotation(np.einsum("mji,mjk->ik", R, R_true))
    return np.rad2deg(rotation_angle(R @ Q @ R_true.transpose(0, 2, 1)))


def best_hand_errors_deg(R: Float, R_true: Float) -> Float:
    """The same for the hand that fits better: images alone cannot tell it."""
    R = np.asarray(R)
    return min(
        rotation_errors_deg(R, R_true),
        rotation_errors_deg(depth_reversed(R), R_true),
        key=np.median,
    )
