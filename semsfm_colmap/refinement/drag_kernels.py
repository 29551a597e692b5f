"""Compiled field of the drag (see `drag`)."""

from __future__ import annotations

import numba

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True, parallel=True)
def fill_drag_field(R: Float, normals: Float, image_idx: Int, track_idx: Int, out: Float) -> None:
    """``n_c (n_x, n_y)`` of each observation into out (O, 2)."""
    for o in numba.prange(len(image_idx)):
        i, j = image_idx[o], track_idx[o]
        n0, n1, n2 = normals[j, 0], normals[j, 1], normals[j, 2]
        cosine = -(R[i, 2, 0] * n0 + R[i, 2, 1] * n1 + R[i, 2, 2] * n2)
        # seen from behind: the normal is not to be trusted
        cosine = max(cosine, 0.0)
        for d in range(2):
            out[o, d] = cosine * (R[i, d, 0] * n0 + R[i, d, 1] * n1 + R[i, d, 2] * n2)
