"""Compiled derivatives of the orthographic projection (see `bundle`)."""

from __future__ import annotations

import numba

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True, parallel=True)
def fill_jacobian(
    R: Float, scale: Float, a: float, k: float, X: Float, image_idx: Int, track_idx: Int, J: Float
) -> None:
    """Derivative of each prediction into J (O, 2, 6 or 8), aspect a and skew k given."""
    for o in numba.prange(len(image_idx)):
        i, j = image_idx[o], track_idx[o]
        s = scale[i]
        u = R[i, 0, 0] * X[j, 0] + R[i, 0, 1] * X[j, 1] + R[i, 0, 2] * X[j, 2]
        v = R[i, 1, 0] * X[j, 0] + R[i, 1, 1] * X[j, 1] + R[i, 1, 2] * X[j, 2]
        z = R[i, 2, 0] * X[j, 0] + R[i, 2, 1] * X[j, 1] + R[i, 2, 2] * X[j, 2]
        # dy_x/dw = (0, y_z, -y_y), dy_y/dw = (-y_z, 0, y_x)
        J[o, 0, 0], J[o, 0, 1], J[o, 0, 2] = -s * k * z, s * z, s * (k * u - v)
        J[o, 1, 0], J[o, 1, 2] = -s * a * z, s * a * u
        J[o, 0, 3], J[o, 1, 3] = s * (u + k * v), s * a * v
        J[o, 0, 4] = J[o, 1, 5] = 1.0
        if J.shape[2] == 8:
            J[o, 1, 6] = s * v
            J[o, 0, 7] = s * v
