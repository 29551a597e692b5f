"""Whether the magnification runs with the angle, or only scatters.

A microscope left alone changes its magnification by 0.05 to 0.3 % within a series, at random or
slowly. One that follows the angle of the specimen is another thing: the specimen sits beside the
tilt axis and comes nearer to the lens as it turns, or the model has put a part of the angle into
the magnification. With the angle a of an image in half ranges from the middle of the series,
-1 <= a <= 1, the relative magnifications m are fitted by

    m = c0 + c1 a + c2 a^2,

and the fit is a finding where its share R^2 of the variance is beyond chance: for magnifications
that know nothing of the angle, (R^2 / 2) / ((1 - R^2) / (M - 3)) is distributed as F(2, M - 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float

MIN_IMAGES = 6
"""Fewer leave too little beside three coefficients."""
CHANCE = 0.001
"""Scatter passes for a trend in one series of a thousand."""
MAX_SPAN = 0.003
"""Magnification drift of scanning electron microscopes within a series is 0.05 to 0.3 %."""


@dataclass(frozen=True, kw_only=True)
class MagnificationTrend:
    """The part of the magnification that follows the angle."""

    span: float
    """largest less smallest relative magnification of the fit"""
    share: float
    """of the variance, R^2"""
    chance: float
    """probability of such a share without any trend"""

    @property
    def is_found(self) -> bool:
        """True where scatter does not explain it."""
        return self.chance < CHANCE

    def is_doubtful(self, disagreement: float, relative_sigma: float) -> bool:
        """True for a trend that no microscope left alone has, or that the error bars do not hold.

        Parameters
        ----------
        disagreement : relative difference of the total rotation between the camera models that the
            images do not rule out, one magnification for all among them
        relative_sigma : standard deviation of the total rotation over itself

        """
        return self.is_found and (self.span > MAX_SPAN or disagreement > relative_sigma)


def magnification_trend(angle_deg: Float, relative_scale: Float) -> MagnificationTrend | None:
    """Fit the magnifications (M,) over the angles (M,); None for too few images or one angle."""
    from scipy.special import fdtrc

    known = np.isfinite(angle_deg) & np.isfinite(relative_scale)
    angle, scale = angle_deg[known], relative_scale[known]
    half = 0.5 * float(np.ptp(angle)) if len(angle) else 0.0
    if len(angle) < MIN_IMAGES or half == 0.0:
        return None
    a = (angle - angle.min()) / half - 1.0
    basis = np.stack([np.ones_like(a), a, a**2], axis=1)
    fit = basis @ np.linalg.lstsq(basis, scale, rcond=None)[0]
    total = float(np.sum((scale - scale.mean()) ** 2))
    if total <= np.finfo(np.float64).eps * len(scale):
        return MagnificationTrend(span=0.0, share=0.0, chance=1.0)
    share = 1.0 - float(np.sum((scale - fit) ** 2)) / total
    freedom = len(angle) - basis.shape[1]
    ratio = (share / 2.0) / max((1.0 - share) / freedom, 1e-300)
    return MagnificationTrend(
        span=float(np.ptp(fit)), share=share, chance=float(fdtrc(2, freedom, ratio))
    )
