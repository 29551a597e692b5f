"""Compiled gradient histograms of patches (see `histograms`)."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, fastmath=True, cache=True)
def gradient_histograms(
    patches: Array,
    place: Array,
    weight: Array,
    num_places: int,
    num_directions: int,
    edge_share: float,
) -> Array:
    """Gradient magnitude by place and direction.

    Parameters
    ----------
    patches : (K, P, P) float32
    place, weight : (P, P, 4) where each sample goes, and how much of it
    edge_share : above 0, only samples count whose gradient is maximal along itself and exceeds this
        share of the patch's mean

    Returns
    -------
    (K, num_places * num_directions) float32

    """
    K, size, _ = patches.shape
    out = np.zeros((K, num_places * num_directions), dtype=np.float32)
    magnitude = np.zeros((size, size), dtype=np.float32)
    position = np.zeros((size, size), dtype=np.float32)
    per_radian = np.float32(num_directions / (2.0 * math.pi))
    for k in range(K):
        total = np.float32(0.0)
        row = out[k]
        patch = patches[k]
        for i in range(1, size - 1):
            for j in range(1, size - 1):
                gx = patch[i, j + 1] - patch[i, j - 1]
                gy = patch[i + 1, j] - patch[i - 1, j]
                # atan2 by a polynomial, good to 2e-4 rad
                ax, ay = abs(gx), abs(gy)
                big = max(ax, ay)
                q = min(ax, ay) / max(big, np.float32(1e-20))
                q2 = q * q
                angle = q * (
                    np.float32(0.99997726)
                    + q2
                    * (
                        np.float32(-0.33262347)
                        + q2
                        * (
                            np.float32(0.19354346)
                            + q2
                            * (
                                np.float32(-0.11643287)
                                + q2 * (np.float32(0.05265332) - q2 * np.float32(0.01172120))
                            )
                        )
                    )
                )
                if ay > ax:
                    angle = np.float32(0.5 * math.pi) - angle
                if gx < 0:
                    angle = np.float32(math.pi) - angle
                if gy < 0:
                    angle = np.float32(2.0 * math.pi) - angle
                m = math.sqrt(gx * gx + gy * gy)
                magnitude[i, j] = m
                position[i, j] = angle * per_radian
                total += m
        limit = np.float32(edge_share) * total / np.float32((size - 2) * (size - 2))
        for i in range(1, size - 1):
            for j in range(1, size - 1):
                m = magnitude[i, j]
                if edge_share > 0.0:
                    if m <= limit:
                        continue
                    angle = position[i, j] / per_radian
                    di, dj = round(math.sin(angle)), round(math.cos(angle))
                    ahead = magnitude[int(i + di), int(j + dj)]
                    behind = magnitude[int(i - di), int(j - dj)]
                    if ahead > m or behind >= m:
                        continue
                low = int(position[i, j])
                share = position[i, j] - low
                if low >= num_directions:
                    low -= num_directions
                high = low + 1
                if high >= num_directions:
                    high = 0
                m1 = m * share
                m0 = m - m1
                for n in range(4):
                    w = weight[i, j, n]
                    if w > 0:
                        base = place[i, j, n] * num_directions
                        row[base + low] += w * m0
                        row[base + high] += w * m1
    return out
