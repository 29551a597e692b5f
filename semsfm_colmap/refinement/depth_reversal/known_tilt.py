"""The direction of a known tilt: it turns round under reversal.

``x_cam(i) = R_i X``; a stage that turns the specimen by the angle theta about the unit vector a,
fixed in the camera frame, makes ``R_i = exp(theta_i [a]) R_0``. Since D has determinant -1,

    D exp(theta [a]) D = exp(theta [-D a]),

and for an axis in the image plane D a = a: the twin turns the other way. (For an axis along the
view -D a = a: a turn in the image plane says nothing.)

A recorded tilt alone has no known direction: makers, and stages of one maker, differ in which way
is positive. It counts only when somebody says which edge of the image goes away from the viewer as
the recorded number grows.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.refinement.depth_reversal.cue import Cue, silent
from semsfm_colmap.types import Float, OrthographicCameras

MAX_TILT_LOGIT = 6.9
"""Log odds of 0.999: a direction stated by hand is wrong now and then."""
MIN_RATIO, MAX_RATIO = 0.5, 2.0
"""Estimated over known tilt outside which the record is not of this series, or not of this axis."""
MAX_SCATTER = 0.3
"""RMS about the line, relative to that of the known tilts, above which they do not belong together:
a correlation of 0.95."""

Edge = Literal["top", "bottom", "left", "right"]


def axis_from_receding_edge(edge: Edge) -> Float:
    """Axis (3,) of a tilt that moves this edge of the image away from the viewer as it grows.

    With x right, y down, z away a right-handed turn about +x takes y to z: the bottom recedes.
    """
    axes = {
        "bottom": (1.0, 0.0, 0.0),
        "top": (-1.0, 0.0, 0.0),
        "left": (0.0, 1.0, 0.0),
        "right": (0.0, -1.0, 0.0),
    }
    if edge not in axes:
        raise UsageError(f"{edge=} but expected one of {', '.join(axes)}.")
    return np.array(axes[edge])


def known_tilt_cue(
    cameras: OrthographicCameras, tilt_rad: Float, axis: Float, sigma_rad: float
) -> Cue:
    """Compare the turn of the cameras with the known one, direction included.

    With e the estimated turn about the axis and theta the known one, both less their means, of
    standard deviation sigma, the log odds of the hand at hand are
    ``sum((e + theta)^2 - (e - theta)^2) / (2 sigma^2) = 2 sum(e theta) / sigma^2``.

    Parameters
    ----------
    tilt_rad : (M,) nan where unknown
    axis : (3,) in the camera frame (x right, y down, z away), about which the specimen turns
        right-handed as the tilt grows; its part along z says nothing and is dropped
    sigma_rad : standard deviation of a known tilt; the scatter found is added to it

    """
    tilt = np.asarray(tilt_rad, dtype=np.float64)
    if tilt.shape != (len(cameras),):
        raise UsageError(f"{tilt.shape=} but expected one tilt for each of {len(cameras)} cameras.")
    if not (np.isfinite(sigma_rad) and sigma_rad > 0):
        raise UsageError(f"{sigma_rad=} but expected a positive number.")
    in_plane = np.array([axis[0], axis[1], 0.0], dtype=np.float64)
    length = float(np.linalg.norm(in_plane))
    if not length > 0.5 * float(np.linalg.norm(axis)):
        raise UsageError(f"{axis=} but expected an axis near the image plane.")
    known = np.flatnonzero(np.isfinite(tilt))
    if len(known) < 2:
        return silent(num_regions=len(known))
    theta = tilt[known] - tilt[known].mean()
    # relative to the middle one in angle, so that no turn comes near 180 degrees
    middle = cameras.cam_from_world[known[np.argsort(theta)[len(theta) // 2]]]
    turn = vector_from_rotation(cameras.cam_from_world[known] @ middle.T)
    estimated = turn @ (in_plane / length)
    estimated = estimated - estimated.mean()
    power = float(theta @ theta)
    if power <= 0.0:
        return silent(num_regions=len(known))
    ratio = float(estimated @ theta) / power
    scatter = float(np.sqrt(np.mean((estimated - ratio * theta) ** 2)))
    sigma = float(np.hypot(sigma_rad, scatter))
    t = ratio * np.sqrt(power) / sigma
    fits = MIN_RATIO < abs(ratio) < MAX_RATIO
    if not fits or scatter > MAX_SCATTER * abs(ratio) * np.sqrt(power / len(theta)):
        return silent(t, len(known))
    logit = np.clip(2.0 * ratio * power / sigma**2, -MAX_TILT_LOGIT, MAX_TILT_LOGIT)
    return Cue(t=t, num_regions=len(known), probability=float(1.0 / (1.0 + np.exp(-logit))))
