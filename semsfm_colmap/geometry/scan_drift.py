"""Places in a frame that crept while it was scanned, as the same frame without drift has them.

A frame of height H px whose last row is displaced by (a, b) px against its first shows what belongs
at q at ``q + (a, b) (v_q - H / 2) / H`` (`refinement/scan_drift.py` estimates a and b).
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float


def without_drift(xy: Float, drift: Float, height_px: Float) -> Float:
    """Where a frame without drift would show what is seen at places (O, 2) px.

    The inverse of the module's formula: first the row, then what it was displaced by.

    Parameters
    ----------
    drift : (O, 2) px over the height of the frame of each place
    height_px : (O,)

    """
    slope = drift / height_px[:, None]
    from_middle = (xy[:, 1] - height_px / 2.0) / (1.0 + slope[:, 1])
    return np.stack([xy[:, 0] - slope[:, 0] * from_middle, height_px / 2.0 + from_middle], axis=-1)


def with_drift(xy: Float, drift: Float, height_px: Float) -> Float:
    """Where a frame that crept shows what one without drift has at places (O, 2) px.

    The module's formula; arguments as those of `without_drift`.
    """
    return np.asarray(xy + drift * ((xy[:, 1] - height_px / 2.0) / height_px)[:, None])
