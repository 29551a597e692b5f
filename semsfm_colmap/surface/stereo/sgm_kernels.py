"""Semi-global smoothing of a cost volume (Hirschmueller, IEEE PAMI 2008), compiled.

Along eight directions r the path cost is

    L(p, d) = C(p, d) + min(L(p - r, d), L(p - r, d +- 1) + P1, min_k L(p - r, k) + P2) - min_k L(p - r, k);

the label of a pixel minimises the sum of the eight. P2 is divided by ``1 + |grey step| / g``: depth
jumps where the image does. Only imported inside functions.
"""  # noqa: E501

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array

_PAD = 10_000
"""More than any path costs, a label's cost and P2: 16-bit integers hold it and are quick."""


@numba.njit(nogil=True, fastmath=True, cache=True, inline="always")
def _step(cost: Array, before: Array, now: Array, total: Array, p1: int, p2: int) -> None:
    """One pixel of one path. `before`, `now`: D + 2 costs padded at the ends, then the least."""
    D = len(cost)
    low = before[D + 2]
    step, jump = np.int16(p1), np.int16(low + p2)
    smallest = np.int16(_PAD)
    for d in range(D):
        value = min(before[d + 1], jump)
        value = min(value, np.int16(before[d] + step))
        value = min(value, np.int16(before[d + 2] + step))
        value = np.int16(value + np.int16(cost[d]))
        value = np.int16(value - low)
        now[d + 1] = value
        total[d] = np.uint16(total[d] + np.uint16(value))
        smallest = min(smallest, value)
    now[D + 2] = smallest


@numba.njit(nogil=True, fastmath=True, cache=True)
def semi_global_sum(cost: Array, grey: Array, p1: int, p2: int, grey_step: float) -> Array:
    """Sum of the eight path costs: (H, W, D) uint8, (H, W) float32 -> (H, W, D) uint16."""
    H, W, D = cost.shape
    total = np.zeros((H, W, D), dtype=np.uint16)
    pad = np.int16(_PAD)
    # paths: 0 along the row, 1-3 from the previous row's left, same and right neighbour
    along = np.full((2, D + 3), pad, dtype=np.int16)
    rows = np.full((2, 3, W + 2, D + 3), pad, dtype=np.int16)
    for direction in (1, -1):
        rows[:, :, :, 1 : D + 3] = 0
        rows[:, :, :, D + 1] = pad
        for i in range(H):
            y = i if direction == 1 else H - 1 - i
            now, before = i % 2, 1 - i % 2
            along[:, 1 : D + 3] = 0
            along[:, D + 1] = pad
            for k in range(W):
                x = k if direction == 1 else W - 1 - k
                for path in range(4):
                    dx = -direction if path == 0 else (path - 2) * direction
                    dy = 0 if path == 0 else -direction
                    xb, yb = x + dx, y + dy
                    edge = p2
                    if 0 <= xb < W and 0 <= yb < H:
                        step = abs(grey[y, x] - grey[yb, xb])
                        edge = max(int(p2 / (1.0 + step / grey_step)), p1 + 1)
                    if path == 0:
                        _step(cost[y, x], along[1 - k % 2], along[k % 2], total[y, x], p1, edge)
                    else:
                        _step(
                            cost[y, x],
                            rows[before, path - 1, xb + 1],
                            rows[now, path - 1, x + 1],
                            total[y, x],
                            p1,
                            edge,
                        )
    return total


@numba.njit(nogil=True, fastmath=True, cache=True)
def best_label(total: Array) -> Array:
    """Label of least cost, moved to the vertex of the parabola there: (H, W) float32."""
    H, W, D = total.shape
    label = np.zeros((H, W), dtype=np.float32)
    for y in range(H):
        for x in range(W):
            best = 0
            for d in range(1, D):
                if total[y, x, d] < total[y, x, best]:
                    best = d
            offset = 0.0
            if 0 < best < D - 1:
                a = float(total[y, x, best - 1])
                b = float(total[y, x, best])
                f = float(total[y, x, best + 1])
                curvature = a - 2.0 * b + f
                if curvature > 0:
                    offset = 0.5 * (a - f) / curvature
            label[y, x] = best + offset
    return label
