"""Robust losses rho(s) of the squared residual norm s, in units of the measurement noise.

All satisfy rho(0) = 0 and rho'(0) = 1; ``weight`` is rho', the weight of iteratively reweighted
least squares. Huber and Cauchy as in Triggs et al. 2000, section 2.
"""

from __future__ import annotations

from typing import Literal

import numba
import numpy as np

from semsfm_colmap.types import Float

LossName = Literal["squared", "huber", "cauchy"]


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


LOSS_NUMBER = {"squared": 0, "huber": 1, "cauchy": 2}
"""Losses as compiled code knows them."""


@numba.njit(cache=True)
def loss_of(number, s, w2):  # type: ignore[no-untyped-def]
    """`loss` of one number, width squared given."""
    if number == 0 or (number == 1 and s <= w2):
        return s
    if number == 1:
        return 2.0 * np.sqrt(w2 * s) - w2
    return w2 * np.log1p(s / w2)


@numba.njit(cache=True)
def weight_of(number, s, w2):  # type: ignore[no-untyped-def]
    """`weight` of one number, width squared given."""
    if number == 0 or (number == 1 and s <= w2):
        return 1.0
    if number == 1:
        return np.sqrt(w2 / s)
    return 1.0 / (1.0 + s / w2)
