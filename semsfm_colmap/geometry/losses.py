"""Robust losses rho(s) of the squared residual norm s, in units of the measurement noise.

All satisfy rho(0) = 0 and rho'(0) = 1; ``weight`` is rho', the weight of iteratively reweighted
least squares. Huber and Cauchy as in Triggs et al. 2000, section 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from semsfm_colmap.types import Float

LossName = Literal["squared", "huber", "cauchy"]
HUBER_TUNING = 1.345
"""Width of Huber's loss in one coordinate: 95 % efficiency on Gaussian errors [Huber 1964]."""
MAD_TO_SIGMA = 1.4826
"""Standard deviation of Gaussian errors over the median of their absolute values."""


def loss(name: LossName, s: Float, width: float) -> Float:
    """rho(s): (O,) -> (O,)."""
    if name == "squared":
        return s
    w2 = width * width
    if name == "huber":
        return np.where(s <= w2, s, 2.0 * width * np.sqrt(np.maximum(s, w2)) - w2)
    return np.asarray(w2 * np.log1p(s / w2))


def weight(name: LossName, s: Float, width: float) -> Float:
    """rho'(s): (O,) -> (O,), in (0, 1]."""
    if name == "squared":
        return np.ones_like(s)
    w2 = width * width
    if name == "huber":
        return np.asarray(width / np.sqrt(np.maximum(s, w2)))
    return np.asarray(1.0 / (1.0 + s / w2))


@dataclass(frozen=True, kw_only=True)
class GaussianConstants:
    """What a robust loss makes of Gaussian noise in two coordinates.

    With w = rho', the estimate that minimises ``sum rho(s)`` has the covariance
    ``(b / a^2) F^-1``, F the information of the squared loss, a = E[w + w' s] the mean slope of the
    influence w r and b = E[w^2 s] / 2 its variance [Huber and Ronchetti 2009, section 7.6].
    """

    gain: float
    """a / b: the factor on rho that makes its curvature, a^2 / b F, the information it delivers, so
    that it is balanced rightly against priors and differences of cost are chi squares"""
    efficiency: float
    """a^2 / b, at most 1: the share of the information that is used"""


@cache
def gaussian_constants(name: LossName, width: float) -> GaussianConstants:
    """Gain and efficiency of a loss, by quadrature over s = |r|^2 / sigma^2 ~ 2 Exp(1)."""
    if name == "squared":
        return GaussianConstants(gain=1.0, efficiency=1.0)
    x = np.linspace(0.0, 60.0, 60001)
    s = 2.0 * x
    w = weight(name, s, width)
    slope = np.gradient(w, s, edge_order=2)

    def mean(f: Float) -> float:
        return float(np.trapezoid(f * np.exp(-x), x))

    a, b = mean(w + slope * s), mean(w * w * s) / 2.0
    return GaussianConstants(gain=a / b, efficiency=a * a / b)


LOSS_NUMBER = {"squared": 0, "huber": 1, "cauchy": 2}
"""Losses as compiled code knows them."""
