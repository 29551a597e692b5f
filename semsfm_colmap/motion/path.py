r"""The path of the specimen in the images while it turns: eccentric circle, drift, and the rest.

The specimen's centre X appears at ``p_i = s_i K2 (R_i X)[:2] + t_i``. Where it lies beside the axis
of rotation it runs on a circle about it, seen from the side an ellipse; a stage or an actuator that
also carries it along adds a drift in proportion to the turn. With u the centre's place beside the
axis (world, normal to the axis), phi the angle about it and v the drift,

    p_i = p_0 + s_i K2 (R_i u)[:2] + phi_i v + rest_i,

fitted by Huber's weights. The rest is what the rotation axis itself does from image to image.
Successive rests hang together (a stage drifts); with r their correlation from one image to the
next, standard deviations are larger by ``sqrt((1 + r) / (1 - r))`` than of independent ones.

Depth does not show in parallel projection. What the circle says of it, ``(R_i u)_z``, is a
consequence of the fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry import losses
from semsfm_colmap.motion.axis import AxisRotation, frame_with_third_axis
from semsfm_colmap.types import Float, OrthographicCameras

MAX_ITERATIONS = 30
EXACT_PX = 1e-9
MIN_RANGE_RAD = math.radians(30.0)
"""Below this rotation circle and drift look alike; only their sum is told."""
MIN_IMAGES = 8
"""Six unknowns, from two coordinates an image, and some to tell the scatter from."""
MAX_CORRELATION = 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class EccentricCircle:
    """What the actuator does to the specimen's centre in each run again."""

    radius_px: float
    """length of u"""
    sigma_px: float
    """largest standard deviation of u along a direction"""
    drift_px_per_rad: Float
    """(2,) v"""
    repeated_px: Float
    """(M, 3) circle and drift in x and y, and in depth the circle alone"""

    @property
    def moves_px(self) -> Float:
        """(M, 3) of the stage from the first image on, to keep the specimen where it was there."""
        return np.asarray(self.repeated_px[0] - self.repeated_px)

    def axis_shift_px(self, centre_px: Float) -> Float:
        """(M, 2) of the rotation axis from its mean place: the path without circle and drift."""
        rest = centre_px - self.repeated_px[:, :2]
        return np.asarray(rest - rest.mean(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecimenPath:
    """The path of the specimen's centre in M images."""

    centre_px: Float
    """(M, 2) p"""
    circle: EccentricCircle | None
    """None where circle and drift cannot be told apart"""

    @property
    def shift_px(self) -> Float:
        """(M, 2) of the specimen's centre from its mean place."""
        return np.asarray(self.centre_px - self.centre_px.mean(axis=0))


def specimen_path(
    cameras: OrthographicCameras, centre: Float, series: AxisRotation
) -> SpecimenPath:
    """The path of a world point (3,) in the images of a series."""
    M = len(cameras)
    p = cameras.project(np.broadcast_to(centre, (M, 3)), np.arange(M))
    if series.range_rad < MIN_RANGE_RAD or M < MIN_IMAGES:
        return SpecimenPath(centre_px=p, circle=None)
    scale = cameras.mean_scale_px_per_unit
    beside = frame_with_third_axis(series.axis_world)[:, :2] / scale
    phi = series.angle_rad - series.angle_rad.mean()
    A = np.zeros((M, 2, 6))
    A[:, :, :2] = np.eye(2)
    A[:, :, 2:4] = cameras.projection @ beside
    A[:, 0, 4], A[:, 1, 5] = phi, phi
    beta, covariance = _fit(A, p)
    depth = scale * cameras.cam_from_world[:, 2] @ (beside @ beta[2:4])
    circle = EccentricCircle(
        radius_px=float(np.linalg.norm(beta[2:4])),
        sigma_px=float(np.sqrt(np.linalg.eigvalsh(covariance[2:4, 2:4])[-1])),
        drift_px_per_rad=beta[4:],
        repeated_px=np.column_stack([A[:, :, 2:] @ beta[2:], depth]),
    )
    return SpecimenPath(centre_px=p, circle=circle)


def _fit(A: Float, p: Float) -> tuple[Float, Float]:
    """Huber's fit of ``A beta`` to p (M, 2), with an image's two coordinates of one weight.

    Parameters
    ----------
    A : (M, 2, n)

    Returns
    -------
    beta (n,) and its covariance

    """
    M, n = len(p), A.shape[2]
    weight = np.ones(M)
    for _ in range(MAX_ITERATIONS):
        normal = np.einsum("i,ikm,ikn->mn", weight, A, A)
        beta = np.linalg.solve(normal, np.einsum("i,ikm,ik->m", weight, A, p))
        rest = p - A @ beta
        length = np.linalg.norm(rest, axis=1)
        # median length of two normal coordinates of sigma 1: sqrt(2 log 2)
        sigma = float(np.median(length)) / math.sqrt(2.0 * math.log(2.0))
        sigma = max(sigma * math.sqrt(2 * M / (2 * M - n)), EXACT_PX)
        weight = losses.weight("huber", (length / sigma) ** 2, losses.HUBER_TUNING)
    together = float(np.sum(rest[1:] * rest[:-1]) / max(np.sum(rest**2), EXACT_PX**2))
    together = min(max(together, 0.0), MAX_CORRELATION)
    return beta, np.linalg.inv(normal) * sigma**2 * (1.0 + together) / (1.0 - together)
