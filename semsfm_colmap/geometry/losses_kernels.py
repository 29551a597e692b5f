"""Compiled losses of one observation (see `losses`), by their numbers in `LOSS_NUMBER`."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def loss_of(number: int, s: float, w2: float) -> float:
    """`losses.loss` of one number, width squared given."""
    if number == 0 or (number == 1 and s <= w2):
        return s
    if number == 1:
        return 2.0 * np.sqrt(w2 * s) - w2
    return w2 * np.log1p(s / w2)


@numba.njit(cache=True)
def weight_of(number: int, s: float, w2: float) -> float:
    """`losses.weight` of one number, width squared given."""
    if number == 0 or (number == 1 and s <= w2):
        return 1.0
    if number == 1:
        return np.sqrt(w2 / s)
    return 1.0 / (1.0 + s / w2)
