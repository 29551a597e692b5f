"""Compiled sums over tracks that make the reduced system (see `reduced`)."""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.geometry.points_kernels import add_observation, invert_symmetric
from semsfm_colmap.types import Bool, Float, Int


@numba.njit(cache=True)
def mark_pairs(image_idx: Int, pointer: Int, mark: Bool) -> None:
    """Set mark[a, b] for images that see a track in common, a at or behind b in the track."""
    for j in range(len(pointer) - 1):
        for a in range(pointer[j], pointer[j + 1]):
            for b in range(pointer[j], a + 1):
                mark[image_idx[a], image_idx[b]] = True


@numba.njit(cache=True, parallel=True)
def accumulate_tracks(
    J: Float,
    A: Float,
    r: Float,
    w: Float,
    image_idx: Int,
    pointer: Int,
    tracks: Int,
    begin_row: Int,
    lookup: Int,
    chunk: Int,
    blocks: Float,
    gradient: Float,
    max_len: int,
) -> None:
    """Add a batch of tracks to the blocks and the gradient.

    Parameters
    ----------
    J : (R, 2, p), its rows those of the batch
    tracks, begin_row : of a `TrackBatch`
    chunk : (C + 1,) where each chunk of the batch's tracks begins
    blocks, gradient : (C, B, p, p) and (C, M, p), partial sums, changed in place
    max_len : the most observations of a track

    """
    p = J.shape[2]
    for c in numba.prange(len(chunk) - 1):
        E = np.zeros((max_len, p, 3))
        F = np.zeros((p, 3))
        H = np.zeros((3, 3))
        Hinv = np.zeros((3, 3))
        b = np.zeros(3)
        for k in range(chunk[c], chunk[c + 1]):
            begin, end = pointer[tracks[k]], pointer[tracks[k] + 1]
            first_row = begin_row[k]
            H[:] = 0.0
            b[:] = 0.0
            for o in range(begin, end):
                add_observation(H, b, A[image_idx[o]], r[o, 0], r[o, 1], w[o])
            if not invert_symmetric(H, Hinv):
                continue
            for o in range(begin, end):
                i = image_idx[o]
                a = o - begin
                row = first_row + a
                own = blocks[c, lookup[i, i]]
                for k in range(p):
                    j0, j1 = w[o] * J[row, 0, k], w[o] * J[row, 1, k]
                    for m in range(3):
                        E[a, k, m] = j0 * A[i, 0, m] + j1 * A[i, 1, m]
                    for m in range(3):
                        F[k, m] = (
                            E[a, k, 0] * Hinv[0, m]
                            + E[a, k, 1] * Hinv[1, m]
                            + E[a, k, 2] * Hinv[2, m]
                        )
                    gradient[c, i, k] += (
                        j0 * r[o, 0]
                        + j1 * r[o, 1]
                        - (F[k, 0] * b[0] + F[k, 1] * b[1] + F[k, 2] * b[2])
                    )
                    for m in range(p):
                        own[k, m] += j0 * J[row, 0, m] + j1 * J[row, 1, m]
                for other in range(a + 1):
                    i2 = image_idx[begin + other]
                    block = blocks[c, lookup[i, i2]]
                    # stored for (later, earlier image); tracks are sorted by image
                    for k in range(p):
                        f0, f1, f2 = F[k, 0], F[k, 1], F[k, 2]
                        for m in range(p):
                            block[k, m] -= (
                                f0 * E[other, m, 0] + f1 * E[other, m, 1] + f2 * E[other, m, 2]
                            )
