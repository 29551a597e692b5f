"""First derivatives of profiles and height maps by the seven-point formula of ISO 21920-2.

    z'_i = (z_{i+3} - 9 z_{i+2} + 45 z_{i+1} - 45 z_{i-1} + 9 z_{i-2} - z_{i-3}) / (60 dx),

of sixth order: right to 0.1 % for waves of 6 cells and more, where the difference of two neighbours
is 17 % too small. Cells with a hole or an end within three cells have none.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float

SEVEN_POINTS = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
REACH = 3


def derivative(z: Float, spacing: float, axis: int) -> Float:
    """Derivative along an axis, nan where a neighbour is missing: any shape, the same."""
    moved = np.moveaxis(np.asarray(z, dtype=np.float64), axis, -1)
    out = np.full(moved.shape, np.nan)
    num = moved.shape[-1] - 2 * REACH
    if num > 0:
        # the middle of the seven has no weight, but must be there
        total = 0.0 * moved[..., REACH : REACH + num]
        for k, w in enumerate(SEVEN_POINTS):
            if w != 0.0:
                total = total + w * moved[..., k : k + num]
        out[..., REACH : REACH + num] = total / spacing
    return np.moveaxis(out, -1, axis)
