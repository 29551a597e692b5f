"""Compiled sums over residuals (see `noise`)."""

from __future__ import annotations

import numba

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True)
def sums_within(
    r: Float, precision: Float, pointer: Int, share: Float, limit: float
) -> tuple[float, float]:
    """Sum of the squared residuals below a limit, and of the share of the variance they keep."""
    squares, expected = 0.0, 0.0
    for j in range(len(share)):
        for o in range(pointer[j], pointer[j + 1]):
            norm2 = (r[o, 0] * r[o, 0] + r[o, 1] * r[o, 1]) * precision[o]
            if norm2 < limit:
                squares += norm2
                expected += share[j]
    return squares, expected
