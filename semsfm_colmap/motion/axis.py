r"""One rotation axis for a whole series, the angle of each image about it, and the closure.

A specimen that turns about an axis fixed in the microscope has poses
``R_i = exp(theta_i [a]_x) R_0``: the direction `a`, fixed in the camera frame, and its image `w`,
fixed in the world, obey ``R_i w = a`` for every image. With weights c_i the pair that minimises
``sum_i c_i |R_i w - a|^2`` are the leading right and left singular vectors of ``sum_i c_i R_i``.
No image is singled out and no angle is unwrapped; for small rotations this is the principal
direction of the rotation vectors. The weights are Cauchy's, so that a badly placed image does not
turn the axis.

The angle of an image is its best approximation by a rotation about the axis: with orthonormal
frames A and W whose third columns are `a` and `w`, ``S = A^T R_i W`` and
``phi_i = atan2(S_10 - S_01, S_00 + S_11)``. What is left over, the angle between ``R_i w`` and
`a`, is the wobble.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.rotations import rotation_angle, wrapped
from semsfm_colmap.types import Float

MIN_ROTATION_RAD = 1e-6
"""Below this total rotation there is no axis: ten times the float64 noise of an arc cosine."""
CAUCHY_TUNING = 2.385
"""95 % efficiency on Gaussian errors (Holland and Welsch 1977)."""
MAX_ITERATIONS = 50
CLOSING_STEPS = 1.5
"""A turn counts as full when it lacks at most this many median steps of 360 degrees."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRotation:
    """The motion of M images as a rotation about one axis."""

    axis_camera: Float
    """(3,) unit vector in the camera frame, signed so that the median step is positive"""
    axis_world: Float
    """(3,) the same direction in the world"""
    angle_rad: Float
    """(M,) about the axis relative to the first image, unwrapped along the series"""
    wobble_rad: Float
    """(M,) angle between the axis and where the image puts it"""

    @property
    def step_rad(self) -> Float:
        """(M - 1,) from each image to the next."""
        return np.diff(self.angle_rad)

    @property
    def range_rad(self) -> float:
        """Largest minus smallest angle."""
        return float(np.ptp(self.angle_rad))

    @property
    def is_full_turn(self) -> bool:
        """True when the images go round once, or lack no more than the closing step."""
        median_step = abs(float(np.median(self.step_rad)))
        return self.range_rad + CLOSING_STEPS * median_step >= 2.0 * np.pi

    @property
    def closing_step_rad(self) -> float:
        """From the last image on to the first, wrapped to (-pi, pi]."""
        return -float(wrapped(self.angle_rad[-1] - self.angle_rad[0]))


def frame_with_third_axis(axis: Float) -> Float:
    """A right-handed orthonormal frame whose third column is `axis`: (3,) -> (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def fit_axis(cam_from_world: Float) -> AxisRotation | None:
    """Fit one axis to the rotations (M, 3, 3) of a series in acquisition order.

    None for fewer than two images, or when nothing rotates.
    """
    R = np.asarray(cam_from_world, dtype=np.float64)
    if len(R) < 2 or np.max(rotation_angle(R @ R[0].T)) < MIN_ROTATION_RAD:
        return None
    weight = np.ones(len(R))
    axis_camera, axis_world = np.zeros(3), np.zeros(3)
    for _ in range(MAX_ITERATIONS):
        U, _, Vt = np.linalg.svd(np.einsum("i,iab->ab", weight / weight.sum(), R))
        converged = abs(U[:, 0] @ axis_camera) > 1.0 - 1e-15
        axis_camera, axis_world = U[:, 0], Vt[0]
        if converged:
            break
        offset = np.linalg.norm(R @ axis_world - axis_camera, axis=1)
        spread = max(MAD_TO_SIGMA * float(np.median(offset)), MIN_ROTATION_RAD)
        weight = 1.0 / (1.0 + (offset / (CAUCHY_TUNING * spread)) ** 2)
    S = frame_with_third_axis(axis_camera).T @ R @ frame_with_third_axis(axis_world)
    phi = np.unwrap(np.arctan2(S[:, 1, 0] - S[:, 0, 1], S[:, 0, 0] + S[:, 1, 1]))
    sign = -1.0 if np.median(np.diff(phi)) < 0.0 else 1.0
    predicted = R @ axis_world
    wobble = np.arctan2(
        np.linalg.norm(np.cross(predicted, axis_camera), axis=1), predicted @ axis_camera
    )
    return AxisRotation(
        axis_camera=sign * axis_camera,
        axis_world=sign * axis_world,
        angle_rad=sign * (phi - phi[0]),
        wobble_rad=wobble,
    )
