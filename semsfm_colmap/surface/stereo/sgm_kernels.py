"""Semi-global smoothing of a cost volume (Hirschmueller, IEEE PAMI 2008), compiled.

Along eight directions r the path cost is

    L(p, d) = C(p, d) + min(L(p - r, d), L(p - r, d +- 1) + P1, min_k L(p - r, k) + P2) - min_k L(p - r, k);

the label of a pixel minimises the sum of the eight. P2 is divided by ``1 + |grey step| / g``: depth
jumps where the image does. Labels are offsets from a base surface: where that jumps by j labels
from p - r to p, its L are those of ``d + j`` (surface_jumps; Scharstein et al., 3DV 2017), so that
what is smooth is the surface and not its offset from a base with flaws. Only imported inside
functions.
"""  # noqa: E501

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array

_PAD = 10_000
"""More than any path costs, a label's cost and P2: 16-bit integers hold it and are quick."""
_FAR = 1_000
"""Labels: farther than any volume reaches."""


@numba.njit(nogil=True, fastmath=True, cache=True, inline="always")
def _step(cost: Array, before: Array, low: int, now: Array, total: Array, p1: int, p2: int) -> int:
    """One pixel of one path, and the least of its costs.

    `before`: D + 2 costs from that of label j - 1 on, the least being `low`; `now`: D costs.
    """
    D = len(cost)
    step, jump = np.int16(p1), np.int16(low + p2)
    smallest = np.int16(_PAD)
    for d in range(D):
        value = min(before[d + 1], jump)
        value = min(value, np.int16(before[d] + step))
        value = min(value, np.int16(before[d + 2] + step))
        value = np.int16(value + np.int16(cost[d]))
        value = np.int16(value - low)
        now[d] = value
        total[d] = np.uint16(total[d] + np.uint16(value))
        smallest = min(smallest, value)
    return int(smallest)


@numba.njit(nogil=True, fastmath=True, cache=True)
def surface_jumps(base: Array, step: float) -> Array:
    """By how many labels a base surface (3, H, W), depths and slopes, jumps between two pixels.

    From the left, the upper left, the upper and the upper right neighbour to each pixel, beyond
    what the slopes of both explain: (4, H, W) int16.
    """
    H, W = base.shape[1:]
    jumps = np.zeros((4, H, W), dtype=np.int16)
    for y in range(H):
        for x in range(W):
            for path in range(4):
                dx, dy = (1, 0) if path == 0 else (2 - path, 1)
                xb, yb = x - dx, y - dy
                if not (0 <= xb < W and yb >= 0):
                    continue
                rise = 0.5 * (base[1, y, x] + base[1, yb, xb]) * dx
                rise += 0.5 * (base[2, y, x] + base[2, yb, xb]) * dy
                jump = (base[0, y, x] - base[0, yb, xb] - rise) / step
                if abs(jump) > 0.5:
                    jumps[path, y, x] = np.int16(min(max(round(jump), -_FAR), _FAR))
    return jumps


@numba.njit(nogil=True, fastmath=True, cache=True)
def semi_global_sum(
    cost: Array, grey: Array, jumps: Array, p1: int, p2: int, grey_step: float
) -> Array:
    """Sum of the eight path costs: (H, W, D) uint16.

    Parameters
    ----------
    cost : (H, W, D) uint8
    grey : (H, W) float32
    jumps : (4, H, W) of `surface_jumps`
    p1, p2, grey_step : the module's P1, P2 and g

    """
    H, W, D = cost.shape
    total = np.zeros((H, W, D), dtype=np.uint16)
    pad = np.int16(_PAD)
    # paths: 0 along the row, 1-3 from the previous row's left, same and right neighbour; the costs
    # of a pixel stand in the middle of three times their room, so that a jump is another beginning
    first = D + 2
    along, along_low = np.full((2, 3 * D + 4), pad, dtype=np.int16), np.zeros(2, dtype=np.int16)
    rows = np.full((2, 3, W + 2, 3 * D + 4), pad, dtype=np.int16)
    rows_low = np.zeros((2, 3, W + 2), dtype=np.int16)
    for direction in (1, -1):
        rows[:, :, :, first : first + D] = 0
        rows_low[:] = 0
        for i in range(H):
            y = i if direction == 1 else H - 1 - i
            now, before = i % 2, 1 - i % 2
            along[:, first : first + D] = 0
            along_low[:] = 0
            for k in range(W):
                x = k if direction == 1 else W - 1 - k
                for path in range(4):
                    dx = -direction if path == 0 else (path - 2) * direction
                    dy = 0 if path == 0 else -direction
                    xb, yb = x + dx, y + dy
                    edge, jump = p2, 0
                    if 0 <= xb < W and 0 <= yb < H:
                        step = abs(grey[y, x] - grey[yb, xb])
                        edge = max(int(p2 / (1.0 + step / grey_step)), p1 + 1)
                        jump = jumps[path, y, x] if direction == 1 else -jumps[path, yb, xb]
                        jump = min(max(jump, -D - 1), D + 1)
                    begin = first - 1 + jump
                    if path == 0:
                        along_low[k % 2] = _step(
                            cost[y, x],
                            along[1 - k % 2, begin : begin + D + 2],
                            along_low[1 - k % 2],
                            along[k % 2, first : first + D],
                            total[y, x],
                            p1,
                            edge,
                        )
                    else:
                        rows_low[now, path - 1, x + 1] = _step(
                            cost[y, x],
                            rows[before, path - 1, xb + 1, begin : begin + D + 2],
                            rows_low[before, path - 1, xb + 1],
                            rows[now, path - 1, x + 1, first : first + D],
                            total[y, x],
                            p1,
                            edge,
                        )
    return total


@numba.njit(nogil=True, fastmath=True, cache=True)
def best_label(total: Array, num: int) -> Array:
    """Of the first `num` labels that of least cost, and the parabola's vertex: (H, W) float32.

    At both ends there is no parabola: what lies beyond is not known.
    """
    H, W = total.shape[:2]
    label = np.zeros((H, W), dtype=np.float32)
    for y in range(H):
        for x in range(W):
            best = 0
            for d in range(1, num):
                if total[y, x, d] < total[y, x, best]:
                    best = d
            offset = 0.0
            if 0 < best < num - 1:
                a = float(total[y, x, best - 1])
                b = float(total[y, x, best])
                f = float(total[y, x, best + 1])
                curvature = a - 2.0 * b + f
                if curvature > 0:
                    offset = 0.5 * (a - f) / curvature
            label[y, x] = best + offset
    return label
