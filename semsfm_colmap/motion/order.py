"""Whether images are in the order of the rotation, and the order they are in.

Along a series in order, forward or backward, steps have one sign for long; of images in no order
two of three steps turn back (of three numbers in random order the middle one is an extreme with
probability 2/3). Images of at most one turn are put into order by their angles alone: on the circle
of all angles the series begins after the largest gap. Images of several turns need a read-out.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.rotations import wrapped
from semsfm_colmap.motion.axis import AxisRotation
from semsfm_colmap.types import Int

MIN_IMAGES = 6
"""Fewer images turn back often by chance."""
MAX_TURNING_BACK = 1.0 / 3.0
"""Share of steps that turn back up to which a series is in order: half of the 2/3 by chance."""
SMALL_STEP = 0.1
"""Steps below this part of the median one say nothing about the direction."""


def is_in_order(series: AxisRotation) -> bool:
    """True when the images follow the rotation, there or there and back.

    Examples
    --------
    >>> from semsfm_colmap.geometry.rotations import rotation_from_vector
    >>> from semsfm_colmap.motion.axis import fit_axis
    >>> angle = np.radians([0, 50, 10, 40, 20, 60, 30])
    >>> R = rotation_from_vector(angle[:, None] * np.array([1.0, 0.0, 0.0]))
    >>> is_in_order(fit_axis(R)), is_in_order(fit_axis(R[order_by_angle(fit_axis(R))]))
    (False, True)

    """
    if len(series.angle_rad) < MIN_IMAGES:
        return True
    step = wrapped(series.step_rad)
    size = np.abs(step)
    sign = np.sign(step[size > SMALL_STEP * float(np.median(size))])
    return bool(np.mean(sign[1:] != sign[:-1]) <= MAX_TURNING_BACK) if len(sign) > 1 else True


def order_by_angle(series: AxisRotation) -> Int:
    """Numbers (M,) of the images in the order of rotation, for at most one turn."""
    angle = np.asarray(series.angle_rad) % (2.0 * np.pi)
    order = np.argsort(angle, kind="stable")
    gap = np.diff(np.append(angle[order], angle[order[0]] + 2.0 * np.pi))
    return np.roll(order, -(int(np.argmax(gap)) + 1))
