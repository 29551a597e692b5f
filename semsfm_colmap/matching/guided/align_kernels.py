"""Compiled alignment of a patch with its predicted affine warp.

The patch T(p) around a point in its reference image and the other image J, read at
``W (p + u) + x`` with W the predicted affine map, are aligned by the shift u that minimises

    sum_p g(p) [ J(W (p + u) + x) - a T(p) - b - c . p ]^2

over u, the gain a, the offset b and the brightness ramp c; g is a Gaussian window. The ramp takes
up shading that slides over the surface, which would otherwise pull the patch along.

Inverse compositional steps (Baker and Matthews, IJCV 56, 2004): the gradient of T stands in for
that of J, so that all but the reading of J is computed once a patch. With ``g_perp`` the part of
the gradient that neither T, a constant nor a ramp explains, and ``H = sum g g_perp g_perp^T``,

    u <- u - H^-1 sum g g_perp J / a

for the brightness terms vanish against g_perp.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.matching.guided.patch_kernels import FREE_ORDER, read_patch
from semsfm_colmap.types import Array

MARGIN = 1
"""The rim of a patch serves for gradients only."""
CONVERGED_PX = 0.003
"""Shift below which the search stops: a tenth of what noise does to it."""
MIN_CONDITION = 1e-3
"""Ratio of the eigenvalues of H below which a patch is an edge that slides along itself."""
LOST_CORRELATION = 0.2
"""Below this after LOST_ITERATIONS the patch is not there: occluded, or too far off."""
LOST_ITERATIONS = 3


@numba.njit(nogil=True, cache=True, error_model="numpy")
def prepare(
    T: Array, window: Array, gradient: Array, texture: Array, inverse: Array, spread: Array
) -> float:
    """What the steps need of a patch; its contrast, 0 when it cannot be aligned.

    Parameters
    ----------
    T, window : (n, n); the window's rim is zero
    gradient : (2, n, n) receives ``g g_perp``
    texture : (n, n) receives ``g T_perp`` for T without constant and ramp
    inverse : (2, 2) receives H^-1
    spread : (2, 2) receives ``H^-1 (sum g^2 g_perp g_perp^T) H^-1``, the covariance of the shift
        when the residuals are white and their weighted mean square is 1

    Returns
    -------
    ``sum g T_perp^2``

    """
    n = T.shape[0]
    radius = (n - 1) // 2
    # the window is symmetric: a constant and the two ramps are orthogonal already
    sw = sxx = 0.0
    mean = rx = ry = 0.0
    for j in range(n):
        for i in range(n):
            w = window[j, i]
            x, y = float(i - radius), float(j - radius)
            sw += w
            sxx += w * x * x
            mean += w * T[j, i]
            rx += w * x * T[j, i]
            ry += w * y * T[j, i]
    mean, rx, ry = mean / sw, rx / sxx, ry / sxx
    contrast = 0.0
    m = np.zeros((2, 4))  # products of the gradient with 1, x, y, T_perp
    for j in range(1, n - 1):
        for i in range(1, n - 1):
            w = window[j, i]
            x, y = float(i - radius), float(j - radius)
            t = T[j, i] - mean - rx * x - ry * y
            texture[j, i] = w * t
            contrast += w * t * t
            for a in range(2):
                g = (
                    0.5 * (T[j, i + 1] - T[j, i - 1])
                    if a == 0
                    else 0.5 * (T[j + 1, i] - T[j - 1, i])
                )
                m[a, 0] += w * g
                m[a, 1] += w * g * x
                m[a, 2] += w * g * y
                m[a, 3] += w * g * t
    if not contrast > 0.0:
        return 0.0
    h00 = h01 = h11 = s00 = s01 = s11 = sww = 0.0
    for j in range(1, n - 1):
        for i in range(1, n - 1):
            w = window[j, i]
            x, y = float(i - radius), float(j - radius)
            t = T[j, i] - mean - rx * x - ry * y
            gx = 0.5 * (T[j, i + 1] - T[j, i - 1])
            gy = 0.5 * (T[j + 1, i] - T[j - 1, i])
            gx -= m[0, 0] / sw + (m[0, 1] * x + m[0, 2] * y) / sxx + m[0, 3] * t / contrast
            gy -= m[1, 0] / sw + (m[1, 1] * x + m[1, 2] * y) / sxx + m[1, 3] * t / contrast
            gradient[0, j, i], gradient[1, j, i] = w * gx, w * gy
            h00 += w * gx * gx
            h01 += w * gx * gy
            h11 += w * gy * gy
            s00 += w * w * gx * gx
            s01 += w * w * gx * gy
            s11 += w * w * gy * gy
            sww += w * w
    trace, det = h00 + h11, h00 * h11 - h01 * h01
    if not det > MIN_CONDITION * trace * trace:
        return 0.0
    i00, i01, i11 = h11 / det, -h01 / det, h00 / det
    # six unknowns make the residuals smaller than the noise
    freedom = 1.0 / (1.0 - 6.0 * sww / (sw * sw))
    inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1] = i00, i01, i01, i11
    # rows of H^-1 S
    p00, p01 = i00 * s00 + i01 * s01, i00 * s01 + i01 * s11
    p10, p11 = i01 * s00 + i11 * s01, i01 * s01 + i11 * s11
    spread[0, 0] = freedom * (p00 * i00 + p01 * i01)
    spread[0, 1] = spread[1, 0] = freedom * (p00 * i01 + p01 * i11)
    spread[1, 1] = freedom * (p10 * i01 + p11 * i11)
    return contrast


@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath=FREE_ORDER)
def products(gradient: Array, texture: Array, J: Array) -> tuple[float, float, float]:
    """Sums of J (n, n) times the two parts of the gradient and times the texture.

    All rims are zero, so that the arrays are run through as a whole.
    """
    gx, gy, t, values = gradient[0].ravel(), gradient[1].ravel(), texture.ravel(), J.ravel()
    bx = by = cross = np.float32(0.0)
    for k in range(values.size):
        bx += gx[k] * values[k]
        by += gy[k] * values[k]
        cross += t[k] * values[k]
    return float(bx), float(by), float(cross)


@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath=FREE_ORDER)
def energy_of(window: Array, J: Array) -> tuple[float, float]:
    """Weighted squares of J without a constant and a ramp, and the sum of the weights."""
    n = window.shape[0]
    radius = (n - 1) // 2
    sw = sxx = s = sx = sy = ss = 0.0
    for j in range(MARGIN, n - MARGIN):
        py = float(j - radius)
        for i in range(MARGIN, n - MARGIN):
            w, value = window[j, i], float(J[j, i])
            px = float(i - radius)
            sw += w
            sxx += w * px * px
            s += w * value
            sx += w * value * px
            sy += w * value * py
            ss += w * value * value
    return ss - s * s / sw - (sx * sx + sy * sy) / sxx, sw


@numba.njit(nogil=True, cache=True, error_model="numpy")
def align(
    gradient: Array,
    texture: Array,
    inverse: Array,
    spread: Array,
    contrast: float,
    window: Array,
    image: Array,
    x: float,
    y: float,
    W: Array,
    max_iterations: int,
    max_shift: float,
    J: Array,
    out: Array,
) -> bool:
    """Align a patch; False when it leaves the image, runs away or is not there.

    Parameters
    ----------
    gradient, texture, inverse, spread, contrast : of the patch, from `prepare`
    x, y : predicted place, pixel index; W : (2, 2) image px per patch px
    max_iterations : most steps
    max_shift : how far from x, y it may end, px of the patch
    J : (n, n) scratch, its rim zero
    out : (6,) place x, y, correlation, and the covariance xx, xy, yy of the place in px^2; the
        last step, below CONVERGED_PX, moves the place and is not looked at again

    """
    radius = (window.shape[0] - 1) // 2
    a, b, c, d = W[0, 0], W[0, 1], W[1, 0], W[1, 1]
    u = v = 0.0
    for iteration in range(max_iterations):
        if not read_patch(image, x + a * u + b * v, y + c * u + d * v, W, radius, MARGIN, J):
            return False
        bx, by, cross = products(gradient, texture, J)
        gain = cross / contrast
        # a negative gain is another pattern
        if not gain > 0.0:
            return False
        du = -(inverse[0, 0] * bx + inverse[0, 1] * by) / gain
        dv = -(inverse[1, 0] * bx + inverse[1, 1] * by) / gain
        done = du * du + dv * dv < CONVERGED_PX * CONVERGED_PX
        if done or iteration == LOST_ITERATIONS:
            energy, sw = energy_of(window, J)
            correlation = cross / math.sqrt(max(contrast * energy, 1e-30))
            if not done and correlation < LOST_CORRELATION:
                return False
        u += du
        v += dv
        if not u * u + v * v <= max_shift * max_shift:
            return False
        if done:
            # what neither gain, offset nor ramp explains, in units of the patch
            variance = max(energy - gain * cross, 0.0) / (sw * gain * gain)
            xx, xy, yy = spread[0, 0], spread[0, 1], spread[1, 1]
            out[0], out[1], out[2] = x + a * u + b * v, y + c * u + d * v, correlation
            out[3] = variance * (a * a * xx + 2.0 * a * b * xy + b * b * yy)
            out[4] = variance * (a * c * xx + (a * d + b * c) * xy + b * d * yy)
            out[5] = variance * (c * c * xx + 2.0 * c * d * xy + d * d * yy)
            return True
    return False


@numba.njit(parallel=True, cache=True, error_model="numpy")
def prepare_all(patches: Array, window: Array) -> tuple[Array, Array, Array, Array, Array]:
    """`prepare` for each patch (K, n, n); the contrast is 0 where one cannot be aligned."""
    num, n = patches.shape[0], patches.shape[1]
    gradient = np.zeros((num, 2, n, n), dtype=np.float32)
    texture = np.zeros((num, n, n), dtype=np.float32)
    inverse = np.zeros((num, 2, 2))
    spread = np.zeros((num, 2, 2))
    contrast = np.zeros(num)
    for k in numba.prange(num):
        if not math.isnan(patches[k, 0, 0]):
            contrast[k] = prepare(
                patches[k].astype(np.float64),
                window,
                gradient[k],
                texture[k],
                inverse[k],
                spread[k],
            )
    return gradient, texture, inverse, spread, contrast


@numba.njit(parallel=True, cache=True, error_model="numpy")
def align_all(
    which: Array,
    gradient: Array,
    texture: Array,
    inverse: Array,
    spread: Array,
    contrast: Array,
    window: Array,
    image: Array,
    places: Array,
    warp: Array,
    max_iterations: int,
    max_shift: float,
) -> Array:
    """`align` for the patches `which` (K,) of all: (K, 6), nan where it failed."""
    out = np.full((len(which), 6), np.nan)
    n = window.shape[0]
    for k in numba.prange(len(which)):
        p = which[k]
        if contrast[p] <= 0.0:
            continue
        J = np.zeros((n, n), dtype=np.float32)
        found = np.empty(6)
        if align(
            gradient[p],
            texture[p],
            inverse[p],
            spread[p],
            contrast[p],
            window,
            image,
            places[k, 0],
            places[k, 1],
            warp[k],
            max_iterations,
            max_shift,
            J,
            found,
        ):
            out[k] = found
    return out
