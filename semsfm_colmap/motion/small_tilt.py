"""How well images alone tell the angle of a small tilt.

With parallel projection the angle of a small tilt is seen in second order only: a change of the
magnification by a fraction s between the images mimics a change of the angle by about
``s * 9000 / range^2``, range in degrees, as measured on rendered series.
"""

from __future__ import annotations

import math

SMALL_ROTATION_DEG = 15.0
"""Below this total rotation angle and depth are seen only in second order: neither a fixed nor a
free magnification is safe (0.1 % of drift shifts the tilt by several percent)."""
DRIFT_TO_TILT = 9000.0
"""Relative error of the tilt per relative change of magnification, times the squared range."""
IMAGES_SIGMA = 0.0004
"""Change of magnification that explains the errors of angles estimated from images alone: 3.3 % at
10 degrees of range, 0.6 at 20, 0.2 at 30 and 0.3 at 40 (subsets of a rendered tilt series)."""
MAX_DRIFT = 0.003
"""Upper end of the changes of magnification that are seen within one series."""
MIN_TOLERANCE = 0.03
"""Stages are calibrated to one or two percent."""


def tilt_error(range_rad: float, magnification_change: float = IMAGES_SIGMA) -> float:
    """Relative error of the angles that an unnoticed change of magnification makes."""
    return magnification_change * DRIFT_TO_TILT / max(math.degrees(range_rad), 1.0) ** 2


def tilt_tolerance(range_rad: float, known_sigma: float = 0.0) -> float:
    """Relative difference up to which estimated and known angles agree: three joint sigmas."""
    return max(MIN_TOLERANCE, 3.0 * math.hypot(tilt_error(range_rad), known_sigma))
