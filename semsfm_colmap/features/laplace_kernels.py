"""Compiled maps and maxima of the detectors (see `laplace`)."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, fastmath=True, cache=True)
def hessian_maps(image: Array, sigma: float) -> tuple[Array, Array]:
    """Scale-normalised determinant of the Hessian and Laplacian: (h, w) -> 2 x (h, w).

    ``sigma^4 (Lxx Lyy - Lxy^2)`` and ``sigma^2 (Lxx + Lyy)``, sigma in px of this image; zero on
    the outermost pixels.
    """
    h, w = image.shape
    det = np.zeros((h, w), dtype=np.float32)
    laplacian = np.zeros((h, w), dtype=np.float32)
    s2 = np.float32(sigma * sigma)
    quarter = np.float32(0.25)
    two = np.float32(2.0)
    for y in range(1, h - 1):
        up, row, down = image[y - 1], image[y], image[y + 1]
        for x in range(1, w - 1):
            xx = s2 * (row[x - 1] + row[x + 1] - two * row[x])
            yy = s2 * (up[x] + down[x] - two * row[x])
            xy = s2 * quarter * (down[x + 1] - down[x - 1] - up[x + 1] + up[x - 1])
            det[y, x] = xx * yy - xy * xy
            laplacian[y, x] = xx + yy
    return det, laplacian


@numba.njit(nogil=True, fastmath=True, cache=True)
def gradient_products(image: Array, sigma: float) -> Array:
    """``sigma^2 (Lx Lx, Ly Ly, Lx Ly)``: (h, w) -> (h, w, 3), zero on the outermost pixels."""
    h, w = image.shape
    out = np.zeros((h, w, 3), dtype=np.float32)
    half = np.float32(0.5 * sigma)
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            gx = half * (image[y, x + 1] - image[y, x - 1])
            gy = half * (image[y + 1, x] - image[y - 1, x])
            out[y, x, 0] = gx * gx
            out[y, x, 1] = gy * gy
            out[y, x, 2] = gx * gy
    return out


@numba.njit(nogil=True, fastmath=True, cache=True)
def cornerness(moments: Array, kappa: float) -> Array:
    """Harris: ``det(mu) - kappa trace(mu)^2``: (h, w, 3) -> (h, w)."""
    h, w, _ = moments.shape
    out = np.empty((h, w), dtype=np.float32)
    k = np.float32(kappa)
    for y in range(h):
        for x in range(w):
            a, b, c = moments[y, x, 0], moments[y, x, 1], moments[y, x, 2]
            out[y, x] = a * b - c * c - k * (a + b) * (a + b)
    return out


@numba.njit(nogil=True, cache=True)
def scale_selected_maxima(
    strength: Array, below: Array, here: Array, above: Array, threshold: float, laplacian_min: float
) -> Array:
    """Maxima of `strength` over 3 x 3 px at which the Laplacian is extremal over scale.

    Position by a quadratic fit of the strength, scale by a parabola through the Laplacian of three
    levels.

    Parameters
    ----------
    strength : (h, w)
    below, here, above : (h, w) normalised Laplacian of three consecutive levels

    Returns
    -------
    (K, 5): x, y in px of this octave, offset of the level, strength, |Laplacian|

    """
    h, w = strength.shape
    window = np.empty((3, 3))
    out = np.empty((1024, 5))
    count = 0
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            v = strength[y, x]
            if v <= threshold:
                continue
            centre = here[y, x]
            sign = 1.0 if centre > 0.0 else -1.0
            mid = sign * centre
            if mid < laplacian_min:
                continue
            low, high = sign * below[y, x], sign * above[y, x]
            if low >= mid or high > mid:
                continue
            if (
                strength[y, x - 1] >= v
                or strength[y, x + 1] > v
                or strength[y - 1, x] >= v
                or strength[y + 1, x] > v
                or strength[y - 1, x - 1] >= v
                or strength[y + 1, x + 1] > v
                or strength[y - 1, x + 1] >= v
                or strength[y + 1, x - 1] > v
            ):
                continue
            # the logarithm of a bump is closer to a parabola than the bump
            lowest = v
            for i in range(3):
                for j in range(3):
                    window[i, j] = strength[y + i - 1, x + j - 1]
                    lowest = min(lowest, window[i, j])
            if lowest > 0.05 * v:
                for i in range(3):
                    for j in range(3):
                        window[i, j] = math.log(window[i, j])
            gx = 0.5 * (window[1, 2] - window[1, 0])
            gy = 0.5 * (window[2, 1] - window[0, 1])
            xx = window[1, 2] + window[1, 0] - 2.0 * window[1, 1]
            yy = window[2, 1] + window[0, 1] - 2.0 * window[1, 1]
            xy = 0.25 * (window[2, 2] - window[2, 0] - window[0, 2] + window[0, 0])
            det = xx * yy - xy * xy
            dx, dy = 0.0, 0.0
            if det > 0.0 and xx < 0.0:
                dx = -(yy * gx - xy * gy) / det
                dy = -(xx * gy - xy * gx) / det
            # a flat top has no sharper position than its pixel
            if abs(dx) > 1.0 or abs(dy) > 1.0:
                dx, dy = 0.0, 0.0
            curvature = low + high - 2.0 * mid
            ds = 0.0
            if curvature < 0.0:
                ds = min(max(0.5 * (low - high) / curvature, -0.5), 0.5)
            if count == len(out):
                bigger = np.empty((2 * count, 5))
                bigger[:count] = out
                out = bigger
            out[count, 0] = x + dx
            out[count, 1] = y + dy
            out[count, 2] = ds
            out[count, 3] = v
            out[count, 4] = mid
            count += 1
    return out[:count]


@numba.njit(nogil=True, cache=True)
def edge_points(image: Array, sigma: float, threshold: float) -> Array:
    """Points where the gradient is maximal along itself [Canny 1986], refined by a parabola.

    Parameters
    ----------
    image : (h, w) of deviation `sigma` px of this image
    threshold : of the strength ``sigma |grad L|``

    Returns
    -------
    (K, 3): x, y in px of this image, strength

    """
    h, w = image.shape
    g = np.zeros((h, w), dtype=np.float32)
    half = 0.5 * sigma
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            gx = half * (image[y, x + 1] - image[y, x - 1])
            gy = half * (image[y + 1, x] - image[y - 1, x])
            g[y, x] = math.sqrt(gx * gx + gy * gy)
    out = np.empty((1024, 3))
    count = 0
    ends = np.empty(2)
    for y in range(2, h - 2):
        for x in range(2, w - 2):
            v = float(g[y, x])
            if v <= threshold:
                continue
            nx = half * (image[y, x + 1] - image[y, x - 1]) / v
            ny = half * (image[y + 1, x] - image[y - 1, x]) / v
            for e in range(2):
                px = x + (2 * e - 1) * nx
                py = y + (2 * e - 1) * ny
                x0, y0 = math.floor(px), math.floor(py)
                fx, fy = px - x0, py - y0
                ends[e] = (1.0 - fy) * ((1.0 - fx) * g[y0, x0] + fx * g[y0, x0 + 1]) + fy * (
                    (1.0 - fx) * g[y0 + 1, x0] + fx * g[y0 + 1, x0 + 1]
                )
            if ends[0] >= v or ends[1] > v:
                continue
            bend = ends[0] + ends[1] - 2.0 * v
            shift = min(max(0.5 * (ends[0] - ends[1]) / bend, -0.5), 0.5) if bend < 0.0 else 0.0
            if count == len(out):
                bigger = np.empty((2 * count, 3))
                bigger[:count] = out
                out = bigger
            out[count, 0] = x + shift * nx
            out[count, 1] = y + shift * ny
            out[count, 2] = v
            count += 1
    return out[:count]
