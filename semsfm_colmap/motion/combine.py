"""Known and seen tilt together: the factor by which all angles of the images are stretched.

Where the two agree (`motion.check`), the common factor of all angles is the weighted mean of what
the images say and what is known. The weight of the images is not their formal error, which
thousands of features make tiny, but what their angles were seen to be wrong by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from semsfm_colmap.motion.check import TiltCheck
from semsfm_colmap.motion.small_tilt import tilt_error


@dataclass(frozen=True, kw_only=True)
class CombinedTilt:
    """What images and knowledge say together about the common factor of all angles."""

    stretch: float
    """To multiply the angles estimated from the images alone with."""
    weight: float
    """Of the known tilts, in 0 to 1."""
    sigma: float
    """One relative standard deviation of the angles after that."""


def combine_tilt(check: TiltCheck, range_rad: float, range_sigma_rad: float) -> CombinedTilt:
    """The mean of the estimated and the known angles, weighted by their variances.

    Parameters
    ----------
    check : of a prior that the images do not contradict, with a factor
    range_rad, range_sigma_rad : largest rotation between two images, and its formal error

    """
    images = math.hypot(range_sigma_rad / range_rad, tilt_error(range_rad))
    weight = images**2 / (images**2 + check.factor_sigma**2)
    return CombinedTilt(
        stretch=abs(check.factor) ** -weight,
        weight=weight,
        sigma=images * check.factor_sigma / math.hypot(images, check.factor_sigma),
    )
