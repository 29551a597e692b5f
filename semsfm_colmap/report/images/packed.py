"""Numbers as the page's script reads them: little-endian bytes in base64.

Places in an image are 16-bit fractions of its width and height, which is 0.01 px in an image of 655
px; regions are an ellipse in four bytes.
"""

from __future__ import annotations

import base64

import numpy as np

from semsfm_colmap.types import Array, Float

FULL = 65535
SCALE_STEP = 1.03
"""Half-axes go up by this factor a step from `SMALLEST_PX`: 3 % at most are lost."""
SMALLEST_PX = 0.25
RESIDUAL_STEP_PX = 0.001


def base64_of(values: Array, dtype: str) -> str:
    """An array as base64 of little-endian numbers."""
    raw = np.ascontiguousarray(values, dtype=np.dtype(dtype).newbyteorder("<")).tobytes()
    return base64.b64encode(raw).decode("ascii")


def packed_places(xy: Float, size_px: tuple[int, int]) -> str:
    """(K, 2) px -> pairs of uint16, fractions of the image."""
    fraction = np.clip(xy / np.array(size_px, dtype=np.float64), 0.0, 1.0)
    return base64_of(np.rint(FULL * fraction), "u2")


def packed_ellipses(shape: Float) -> str:
    """(K, 2, 2) -> four bytes each.

    Logarithm of the longer half-axis (0: no region), ratio of the axes, direction of the longer one
    (half a turn) and orientation (a whole turn), both from x toward y.
    """
    U, S, _ = np.linalg.svd(shape)
    longer, shorter = S[:, 0], S[:, 1]
    none = longer <= 0.0
    safe = np.where(none, 1.0, longer)
    size = 1 + np.rint(np.log(np.maximum(safe, SMALLEST_PX) / SMALLEST_PX) / np.log(SCALE_STEP))
    axis = np.arctan2(U[:, 1, 0], U[:, 0, 0]) % np.pi / np.pi
    orientation = np.arctan2(shape[:, 1, 0], shape[:, 0, 0]) % (2.0 * np.pi) / (2.0 * np.pi)
    rows = np.stack(
        [
            np.where(none, 0, np.minimum(size, 255)),
            np.rint(255.0 * shorter / safe),
            np.rint(256.0 * axis) % 256,
            np.rint(256.0 * orientation) % 256,
        ],
        axis=1,
    )
    return base64_of(rows, "u1")


def packed_residuals(residual: Float) -> str:
    """(K, 2) px -> pairs of int16 in steps of `RESIDUAL_STEP_PX`; 32 px is the most."""
    return base64_of(np.clip(np.rint(residual / RESIDUAL_STEP_PX), -32768, 32767), "i2")
