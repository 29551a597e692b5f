"""Compiled covariance of the points, one track after the other (see `covariance`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.points_kernels import add_observation, invert_symmetric
from semsfm_colmap.types import Float, Int


@numba.njit(cache=True, parallel=True)
def point_covariance(
    J: Float,
    A: Float,
    w: Float,
    image_idx: Int,
    pointer: Int,
    tracks: Int,
    begin_row: Int,
    lookup: Int,
    C: Float,
    out: Float,
) -> None:
    """Covariance (N, 3, 3) of the points of a batch of tracks, nan where one is not fixed.

    Parameters
    ----------
    J : (R, 2, p), its rows those of the batch
    tracks, begin_row : of a `TrackBatch`
    lookup, C : (M, M) and (B, p, p), covariance of the cameras by pairs of images

    """
    p = J.shape[2]
    for t in numba.prange(len(tracks)):
        j = tracks[t]
        begin, end = pointer[j], pointer[j + 1]
        # where the track begins in J
        shift = begin_row[t] - begin
        H = np.zeros((3, 3))
        b = np.zeros(3)
        inverse = np.zeros((3, 3))
        for o in range(begin, end):
            add_observation(H, b, A[image_idx[o]], 0.0, 0.0, w[o])
        if not invert_symmetric(H, inverse):
            out[j] = np.nan
            continue
        E = np.zeros((end - begin, p, 3))
        for o in range(begin, end):
            i = image_idx[o]
            for k in range(p):
                for m in range(3):
                    E[o - begin, k, m] = w[o] * (
                        J[o + shift, 0, k] * A[i, 0, m] + J[o + shift, 1, k] * A[i, 1, m]
                    )
        # B = E^T C E, summed over all pairs of observations of the track
        B = np.zeros((3, 3))
        CE = np.zeros((p, 3))
        for o in range(begin, end):
            for q in range(begin, o + 1):
                # stored for (later, earlier image); tracks are sorted by image
                block = C[lookup[image_idx[o], image_idx[q]]]
                CE[:] = 0.0
                for k in range(p):
                    for m in range(p):
                        for y in range(3):
                            CE[k, y] += block[k, m] * E[q - begin, m, y]
                for x in range(3):
                    for y in range(3):
                        value = 0.0
                        for k in range(p):
                            value += E[o - begin, k, x] * CE[k, y]
                        B[x, y] += value
                        # the pair the other way round is the transpose
                        if q < o:
                            B[y, x] += value
        out[j] = inverse + inverse @ B @ inverse
