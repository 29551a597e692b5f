"""Compiled kernels on regions: sampling, orientation, second-moment adaptation."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array

ORIENTATION_BINS = 36
"""Lowe 2004"""
ORIENTATION_RADIUS = 9
"""Samples from the centre to the edge of the window, half a scale apart: 4.5 scales."""
ADAPTATION_RADIUS = 9


@numba.njit(nogil=True, fastmath=True, cache=True)
def sample_patches(image: Array, xy: Array, shape: Array, half_width: float, size: int) -> Array:
    """Patches in normalised coordinates by bilinear interpolation, the border repeated.

    Sample (i, j) of a patch lies at ``xy + shape @ (g[j], g[i])`` with g of `size` values at the
    centres of equal cells of [-half_width, half_width].

    Parameters
    ----------
    image : (h, w) float32
    xy : (K, 2) pixel indices
    shape : (K, 2, 2)

    Returns
    -------
    (K, size, size) float32

    """
    h, w = image.shape
    K = len(xy)
    out = np.empty((K, size, size), dtype=np.float32)
    pitch = 2.0 * half_width / size
    first = -half_width + 0.5 * pitch
    for k in range(K):
        a, b = shape[k, 0, 0] * pitch, shape[k, 0, 1] * pitch
        c, d = shape[k, 1, 0] * pitch, shape[k, 1, 1] * pitch
        x0 = xy[k, 0] + (shape[k, 0, 0] + shape[k, 0, 1]) * first
        y0 = xy[k, 1] + (shape[k, 1, 0] + shape[k, 1, 1]) * first
        for i in range(size):
            for j in range(size):
                x = min(max(x0 + a * j + b * i, 0.0), w - 1.001)
                y = min(max(y0 + c * j + d * i, 0.0), h - 1.001)
                xi, yi = int(x), int(y)
                fx, fy = np.float32(x - xi), np.float32(y - yi)
                top = image[yi, xi] + fx * (image[yi, xi + 1] - image[yi, xi])
                bottom = image[yi + 1, xi] + fx * (image[yi + 1, xi + 1] - image[yi + 1, xi])
                out[k, i, j] = top + fy * (bottom - top)
    return out


@numba.njit(nogil=True, fastmath=True, cache=True)
def orientations(patches: Array, num: int, peak_share: float) -> tuple[Array, Array]:
    """Dominant gradient directions of patches of 2 ORIENTATION_RADIUS + 3 samples a side.

    A histogram of 36 directions, weighted by magnitude and a Gaussian of 1.5 scales, smoothed;
    its peaks by parabolas [Lowe 2004, section 5].

    Returns
    -------
    (K, num) angles in radians and (K,) how many of them hold

    """
    K, size, _ = patches.shape
    radius = ORIENTATION_RADIUS
    bins = ORIENTATION_BINS
    angles = np.zeros((K, num))
    counts = np.zeros(K, dtype=np.int64)
    weight = np.zeros((size, size))
    for i in range(1, size - 1):
        for j in range(1, size - 1):
            r2 = float((i - radius - 1) ** 2 + (j - radius - 1) ** 2)
            if r2 <= (radius + 0.5) ** 2:
                weight[i, j] = math.exp(-r2 / (2.0 * 3.0**2))
    histogram = np.empty(bins)
    smooth = np.empty(bins)
    for k in range(K):
        histogram[:] = 0.0
        for i in range(1, size - 1):
            for j in range(1, size - 1):
                if weight[i, j] == 0.0:
                    continue
                gx = patches[k, i, j + 1] - patches[k, i, j - 1]
                gy = patches[k, i + 1, j] - patches[k, i - 1, j]
                magnitude = weight[i, j] * math.sqrt(gx * gx + gy * gy)
                position = math.atan2(gy, gx) * (bins / (2.0 * math.pi)) + bins
                low = int(position)
                share = position - low
                histogram[low % bins] += (1.0 - share) * magnitude
                histogram[(low + 1) % bins] += share * magnitude
        for _ in range(3):
            for n in range(bins):
                smooth[n] = (
                    histogram[n] * 2.0 + histogram[n - 1] + histogram[(n + 1) % bins]
                ) / 4.0
            histogram[:] = smooth
        highest = histogram.max()
        if highest <= 0.0:
            counts[k] = 1
            continue
        used = np.zeros(bins, dtype=np.bool_)
        for m in range(num):
            best = -1
            for n in range(bins):
                v = histogram[n]
                if (
                    not used[n]
                    and v >= peak_share * highest
                    and v > histogram[n - 1]
                    and v >= histogram[(n + 1) % bins]
                    and (best < 0 or v > histogram[best])
                ):
                    best = n
            if best < 0:
                break
            used[best] = True
            left, v, right = histogram[best - 1], histogram[best], histogram[(best + 1) % bins]
            bend = left + right - 2.0 * v
            shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
            angles[k, m] = ((best + shift) % bins) * (2.0 * math.pi / bins)
            counts[k] = m + 1
        if counts[k] == 0:
            counts[k] = 1
    return angles, counts


@numba.njit(nogil=True, fastmath=True, cache=True)
def adapt_shapes(
    image: Array, xy: Array, scale: Array, iterations: int, convergence: float, max_ratio: float
) -> tuple[Array, Array]:
    """Second-moment adaptation: the shape in which a region's gradients are isotropic.

    Iterates ``U <- U mu(U)^(-1/2)``, determinant kept at 1, mu the second-moment matrix of the
    region sampled under U with a Gaussian window (Lindeberg and Garding 1997; Baumberg, CVPR 2000;
    Mikolajczyk and Schmid, IJCV 60, 2004). The rotation left open is fixed so that "up" stays up:
    U is lower triangular (Perdoch, Chum, Matas, CVPR 2009).

    Parameters
    ----------
    image : (h, w) float32, one level
    xy : (K, 2), scale : (K,) px of that level

    Returns
    -------
    (K, 2, 2) shapes and (K,) True where converged and not too elongated

    """
    h, w = image.shape
    K = len(xy)
    shapes = np.zeros((K, 2, 2))
    good = np.zeros(K, dtype=np.bool_)
    r = ADAPTATION_RADIUS
    size = 2 * r + 3
    patch = np.empty((size, size), dtype=np.float32)
    window = np.zeros((size, size), dtype=np.float32)
    for i in range(1, size - 1):
        for j in range(1, size - 1):
            r2 = float((i - r - 1) ** 2 + (j - r - 1) ** 2)
            if r2 <= (r + 0.5) ** 2:
                window[i, j] = math.exp(-r2 / (2.0 * (r / 2.5) ** 2))
    for k in range(K):
        u11, u12, u21, u22 = 1.0, 0.0, 0.0, 1.0
        pitch = scale[k] * 3.0 / r
        for _ in range(iterations):
            for i in range(size):
                for j in range(size):
                    gx, gy = (j - r - 1) * pitch, (i - r - 1) * pitch
                    x = min(max(xy[k, 0] + u11 * gx + u12 * gy, 0.0), w - 1.001)
                    y = min(max(xy[k, 1] + u21 * gx + u22 * gy, 0.0), h - 1.001)
                    xi, yi = int(x), int(y)
                    fx, fy = np.float32(x - xi), np.float32(y - yi)
                    top = image[yi, xi] + fx * (image[yi, xi + 1] - image[yi, xi])
                    low = image[yi + 1, xi] + fx * (image[yi + 1, xi + 1] - image[yi + 1, xi])
                    patch[i, j] = top + fy * (low - top)
            a, b, c = 0.0, 0.0, 0.0
            for i in range(1, size - 1):
                for j in range(1, size - 1):
                    dx = patch[i, j + 1] - patch[i, j - 1]
                    dy = patch[i + 1, j] - patch[i - 1, j]
                    a += window[i, j] * dx * dx
                    b += window[i, j] * dy * dy
                    c += window[i, j] * dx * dy
            det = a * b - c * c
            if det <= 1e-12 * (a + b) * (a + b) or a + b <= 0.0:
                break
            # square root of the matrix: (mu + sqrt(det) I) / sqrt(trace + 2 sqrt(det))
            root = math.sqrt(det)
            norm = math.sqrt(a + b + 2.0 * root)
            s11, s22, s12 = (a + root) / norm, (b + root) / norm, c / norm
            # its inverse with determinant 1
            f = 1.0 / math.sqrt(root)
            m11, m22, m12 = s22 * f, s11 * f, -s12 * f
            spread = math.sqrt(((a - b) * 0.5) ** 2 + c * c)
            isotropy = math.sqrt(((a + b) * 0.5 - spread) / ((a + b) * 0.5 + spread))
            n11 = u11 * m11 + u12 * m12
            n12 = u11 * m12 + u12 * m22
            n21 = u21 * m11 + u22 * m12
            n22 = u21 * m12 + u22 * m22
            u11, u12, u21, u22 = n11, n12, n21, n22
            # singular values, determinant 1: s + 1/s from the Frobenius norm
            frobenius = u11 * u11 + u12 * u12 + u21 * u21 + u22 * u22
            half = 0.5 * frobenius
            ratio = half + math.sqrt(max(half * half - 1.0, 0.0))
            if ratio > max_ratio:
                break
            if 1.0 - isotropy < convergence:
                good[k] = True
                break
        # U U^T fixes the ellipse; its Cholesky factor is the lower triangular root
        e11 = u11 * u11 + u12 * u12
        e12 = u11 * u21 + u12 * u22
        l11 = math.sqrt(e11)
        shapes[k, 0, 0] = l11
        shapes[k, 1, 0] = e12 / l11
        shapes[k, 1, 1] = 1.0 / l11
    return shapes, good
