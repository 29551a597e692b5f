"""Compiled kernels of the texture: which face covers a texel, and what an image adds to it."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, cache=True)
def rasterize(uv: Array, width: int, height: int, reach: float) -> tuple[Array, Array]:
    """The face at each texel and its barycentric coordinates.

    A texel's centre may lie up to `reach` texels outside its triangle: so every triangle gets a
    border, and interpolation at its edge does not pick up empty texels.

    Parameters
    ----------
    uv : (F, 3, 2) float64, in texels, row 0 at the top
    width, height : of the texture
    reach : texels

    Returns
    -------
    (H, W) int32 face or -1; (H, W, 2) float32 coordinates of corners 1 and 2

    """
    face = np.full((height, width), -1, dtype=np.int32)
    bary = np.zeros((height, width, 2), dtype=np.float32)
    depth_out = np.full((height, width), np.inf, dtype=np.float32)
    for f in range(len(uv)):
        ax, ay = uv[f, 0, 0], uv[f, 0, 1]
        bx, by = uv[f, 1, 0] - ax, uv[f, 1, 1] - ay
        cx, cy = uv[f, 2, 0] - ax, uv[f, 2, 1] - ay
        det = bx * cy - by * cx
        if det == 0.0:
            continue
        # how fast each barycentric coordinate grows per texel
        g0 = math.hypot(bx - cx, by - cy) / abs(det)
        g1 = math.hypot(cx, cy) / abs(det)
        g2 = math.hypot(bx, by) / abs(det)
        x_low = max(0, math.floor(min(ax, ax + bx, ax + cx) - reach - 0.5))
        x_high = min(width - 1, math.ceil(max(ax, ax + bx, ax + cx) + reach))
        y_low = max(0, math.floor(min(ay, ay + by, ay + cy) - reach - 0.5))
        y_high = min(height - 1, math.ceil(max(ay, ay + by, ay + cy) + reach))
        for y in range(y_low, y_high + 1):
            for x in range(x_low, x_high + 1):
                px, py = x + 0.5 - ax, y + 0.5 - ay
                b1 = (px * cy - py * cx) / det
                b2 = (bx * py - by * px) / det
                outside = max(-b1 / g1, -b2 / g2, (b1 + b2 - 1.0) / g0, 0.0)
                if outside <= reach and outside < depth_out[y, x]:
                    depth_out[y, x] = outside
                    face[y, x] = f
                    bary[y, x, 0] = b1
                    bary[y, x, 1] = b2
    return face, bary


@numba.njit(nogil=True, fastmath=True, cache=True)
def add_image(
    face: Array,
    bary: Array,
    corners: Array,
    corner_xy: Array,
    corner_weight: Array,
    corner_factor: Array,
    grey: Array,
    total: Array,
    norm: Array,
) -> None:
    """Add one image to the texels of the faces it sees, in place.

    Parameters
    ----------
    face, bary : from `rasterize`
    corners : (F, 3) vertex indices
    corner_xy : (V, 2) float32, where the image sees each vertex, px
    corner_weight : (V,) float32
    corner_factor : (V,) float32, grey over albedo at each vertex
    grey : (H, W) float32
    total, norm : (Ht, Wt) float32, sums of w * grey and w * factor

    """
    Hi, Wi = grey.shape
    for y in range(face.shape[0]):
        for x in range(face.shape[1]):
            f = face[y, x]
            if f < 0:
                continue
            i, j, k = corners[f, 0], corners[f, 1], corners[f, 2]
            if corner_weight[i] + corner_weight[j] + corner_weight[k] <= 0.0:
                continue
            b1, b2 = bary[y, x, 0], bary[y, x, 1]
            b0 = np.float32(1.0) - b1 - b2
            w = b0 * corner_weight[i] + b1 * corner_weight[j] + b2 * corner_weight[k]
            if w <= 0.0:
                continue
            u = b0 * corner_xy[i, 0] + b1 * corner_xy[j, 0] + b2 * corner_xy[k, 0] - 0.5
            v = b0 * corner_xy[i, 1] + b1 * corner_xy[j, 1] + b2 * corner_xy[k, 1] - 0.5
            if not (0.0 <= u < Wi - 1 and 0.0 <= v < Hi - 1):
                continue
            iu, iv = int(u), int(v)
            fu, fv = u - iu, v - iv
            top = grey[iv, iu] + fu * (grey[iv, iu + 1] - grey[iv, iu])
            low = grey[iv + 1, iu] + fu * (grey[iv + 1, iu + 1] - grey[iv + 1, iu])
            factor = b0 * corner_factor[i] + b1 * corner_factor[j] + b2 * corner_factor[k]
            total[y, x] += w * (top + fv * (low - top))
            norm[y, x] += w * factor
