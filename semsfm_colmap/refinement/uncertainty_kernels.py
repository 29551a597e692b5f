"""Compiled sums over observations for error bars with modes (see `uncertainty`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.points_kernels import add_observation, invert_symmetric
from semsfm_colmap.types import Float, Int


@numba.njit(cache=True)
def add_pull(J: Float, r: Float, w: Float, image_idx: Int, group: Int, out: Float) -> None:
    """``J_o^T w_o r_o`` added to out (M, p, K) by image and group."""
    for o in range(len(image_idx)):
        i, k = image_idx[o], group[o]
        for m in range(J.shape[2]):
            out[i, m, k] += w[o] * (J[o, 0, m] * r[o, 0] + J[o, 1, m] * r[o, 1])


@numba.njit(cache=True, parallel=True)
def fill_point_modes(
    J: Float, A: Float, w: Float, image_idx: Int, pointer: Int, modes: Float, out: Float
) -> None:
    """How each point follows modes (M, p, K) of the cameras, into out (N, 3, K)."""
    p, K = J.shape[2], modes.shape[2]
    for j in numba.prange(len(pointer) - 1):
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        E = np.zeros((3, K))
        for o in range(pointer[j], pointer[j + 1]):
            i = image_idx[o]
            add_observation(H, b, A[i], 0.0, 0.0, w[o])
            for m in range(p):
                for x in range(3):
                    c = w[o] * (J[o, 0, m] * A[i, 0, x] + J[o, 1, m] * A[i, 1, x])
                    for k in range(K):
                        E[x, k] -= c * modes[i, m, k]
        if not invert_symmetric(H, inverse):
            out[j] = np.nan
            continue
        for x in range(3):
            for k in range(K):
                out[j, x, k] = (
                    inverse[x, 0] * E[0, k] + inverse[x, 1] * E[1, k] + inverse[x, 2] * E[2, k]
                )
