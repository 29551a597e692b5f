"""Compiled kernel that sharpens a depth map: Gauss-Newton on slanted windows."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def slanted_step(
    reference: Array,
    lit: Array,
    plane: Array,
    views: Array,
    view_usable: Array,
    B: Array,
    c: Array,
    e: Array,
    window: Array,
    window_weight: Array,
    noise: Array,
    grey_cut: float,
    spread: float,
    smoothness: float,
    stride: int,
    depth: Array,
    score: Array,
    information: Array,
) -> None:
    """One Gauss-Newton step of every pixel's depth, in place.

    The window is a patch of the plane ``z + p dx + q dy``; neighbour j sees it through the affine
    map ``B + c (p, q)^T``. With a and b the weighted, centred and normalised greys of reference and
    neighbour, minimise over z ``sum_j w_j |a - b_j(z)|^2``, where ``db/dz = (I - b b^T) G / norm``
    and G is the change of the neighbour's grey with depth. Samples whose grey differs from the
    centre's by `grey_cut` do not count (Yoon and Kweon 2006, with Tukey's weight): the window keeps
    to the centre's surface. A neighbour's weight falls with its correlation, to nothing at `spread`
    below the best one's: an occluded neighbour does not count. The step is shortened as if the
    local plane had predicted the depth with the information `smoothness`.

    Parameters
    ----------
    reference : (H, W) float32
    lit : (V, H, W) float32, the reference in the light of each neighbour (`relight`)
    plane : (3, H, W) from `plane_kernels.local_planes`
    views : (V, H', W', 2) float32, grey and its change with depth
    view_usable : (V, H', W') uint8
    B, c, e : the maps of `AffineSweep`
    window, window_weight : (K, 2) int64 offsets of the window's samples, (K,) float32
    noise : (1 + V,) deviations
    stride : pixels with ``(x + y) % stride == 0`` are moved; the others get the depth of their
        plane and the score 0, with which they have no say in the next planes
    depth, score : (H, W) float32, overwritten: depth and mean correlation
    information : (H, W) float32, overwritten: inverse variance of the depth by the windows alone,
        per world unit squared; zero where no neighbour counts

    """
    H, W = reference.shape
    V, Hj, Wj = views.shape[:3]
    count = len(window)
    reach = np.abs(window).max()
    offset = window.astype(np.float32)
    weight = np.zeros(count, dtype=np.float32)
    a = np.zeros(count, dtype=np.float32)
    b = np.zeros(count, dtype=np.float32)
    g = np.zeros(count, dtype=np.float32)
    map_j = np.zeros(6, dtype=np.float32)
    terms = np.zeros((V, 3), dtype=np.float32)
    max_step = 0.5 / np.sqrt((c * c).sum(axis=1).max())
    for y in range(H):
        for x in range(W):
            z, p, q = plane[0, y, x], plane[1, y, x], plane[2, y, x]
            information[y, x] = 0.0
            if not math.isfinite(z):
                depth[y, x] = np.nan
                score[y, x] = 0.0
                continue
            if (x + y) % stride != 0:
                depth[y, x] = z
                score[y, x] = 0.0
                continue
            _window_weights(reference, x, y, window, window_weight, grey_cut, weight)
            for j in range(V):
                u = B[j, 0, 0] * (x + 0.5) + B[j, 0, 1] * (y + 0.5) + c[j, 0] * z + e[j, 0] - 0.5
                v = B[j, 1, 0] * (x + 0.5) + B[j, 1, 1] * (y + 0.5) + c[j, 1] * z + e[j, 1] - 0.5
                terms[j, 0] = -2.0
                terms[j, 1] = terms[j, 2] = 0.0
                if not (reach <= u < Wj - 1 - reach and reach <= v < Hj - 1 - reach):
                    continue
                if view_usable[j, int(v), int(u)] == 0:
                    continue
                map_j[0], map_j[1] = B[j, 0, 0] + c[j, 0] * p, B[j, 0, 1] + c[j, 0] * q
                map_j[2], map_j[3] = B[j, 1, 0] + c[j, 1] * p, B[j, 1, 1] + c[j, 1] * q
                map_j[4], map_j[5] = u, v
                _reference_window(lit[j], x, y, window, weight, noise[0], a)
                view_terms(views[j], map_j, offset, weight, a, noise[1 + j], b, g, terms[j])

            best = max(terms[:, 0].max(), 0.0)
            sum_w = mean_ncc = numerator = denominator = 0.0
            for j in range(V):
                w = max(1.0 - (best - terms[j, 0]) / spread, 0.0)
                sum_w += w
                mean_ncc += w * terms[j, 0]
                numerator += w * terms[j, 1]
                denominator += w * terms[j, 2]
            if sum_w <= 0.0:
                depth[y, x] = np.nan
                score[y, x] = 0.0
                continue
            mean_ncc /= sum_w
            # 2 (1 - ncc) is the mean squared difference of normalised greys; about half of the
            # window's samples are independent
            known = denominator * 0.5 * count / max(2.0 * (1.0 - mean_ncc), 0.02)
            step = numerator / (denominator + 1e-12)
            step = min(max(step, -max_step), max_step)
            depth[y, x] = z + step * known / (known + smoothness + 1e-12)
            score[y, x] = mean_ncc
            information[y, x] = known


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _window_weights(
    reference: Array,
    x: int,
    y: int,
    window: Array,
    window_weight: Array,
    grey_cut: float,
    weight: Array,
) -> None:
    """Weights of a window's samples that sum to one, in place."""
    H, W = reference.shape
    centre = reference[y, x]
    total = np.float32(0.0)
    inv_cut = np.float32(1.0 / grey_cut)
    for k in range(len(window)):
        xx, yy = x + window[k, 0], y + window[k, 1]
        weight[k] = 0.0
        if 0 <= xx < W and 0 <= yy < H:
            t = (reference[yy, xx] - centre) * inv_cut
            w = max(np.float32(1.0) - t * t, np.float32(0.0))
            weight[k] = w * w * window_weight[k]
            total += weight[k]
    for k in range(len(window)):
        weight[k] /= total


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _reference_window(
    grey: Array, x: int, y: int, window: Array, weight: Array, noise: float, a: Array
) -> None:
    """Centred greys of unit norm, in place; samples beyond the border have no weight."""
    H, W = grey.shape
    mean = power = np.float32(0.0)
    for k in range(len(window)):
        xx = min(max(x + window[k, 0], 0), W - 1)
        yy = min(max(y + window[k, 1], 0), H - 1)
        a[k] = grey[yy, xx]
        mean += weight[k] * a[k]
    for k in range(len(window)):
        a[k] -= mean
        power += weight[k] * a[k] * a[k]
    norm = np.float32(1.0 / math.sqrt(power + noise * noise))
    for k in range(len(window)):
        a[k] *= norm


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def view_terms(
    view: Array,
    affine: Array,
    offset: Array,
    weight: Array,
    a: Array,
    noise: float,
    b: Array,
    g: Array,
    terms: Array,
) -> None:
    """Correlation, and numerator and denominator of the Gauss-Newton step, of one neighbour."""
    last_u = np.float32(view.shape[1] - 1.01)
    last_v = np.float32(view.shape[0] - 1.01)
    zero, one, right = np.float32(0.0), np.float32(1.0), np.uint32(1)
    mean_b = mean_g = zero
    for k in range(len(weight)):
        u = affine[4] + affine[0] * offset[k, 0] + affine[1] * offset[k, 1]
        v = affine[5] + affine[2] * offset[k, 0] + affine[3] * offset[k, 1]
        u = min(max(u, zero), last_u)
        v = min(max(v, zero), last_v)
        iu, iv = np.uint32(u), np.uint32(v)
        fu, fv = u - np.float32(iu), v - np.float32(iv)
        ju, jv = iu + right, iv + right
        w11 = fu * fv
        w01 = fu - w11
        w10 = fv - w11
        w00 = one - fu - w10
        b[k] = (
            w00 * view[iv, iu, 0]
            + w01 * view[iv, ju, 0]
            + w10 * view[jv, iu, 0]
            + w11 * view[jv, ju, 0]
        )
        g[k] = (
            w00 * view[iv, iu, 1]
            + w01 * view[iv, ju, 1]
            + w10 * view[jv, iu, 1]
            + w11 * view[jv, ju, 1]
        )
        mean_b += weight[k] * b[k]
        mean_g += weight[k] * g[k]
    power = cross = zero
    for k in range(len(weight)):
        b[k] -= mean_b
        g[k] -= mean_g
        power += weight[k] * b[k] * b[k]
        cross += weight[k] * b[k] * g[k]
    norm = np.float32(1.0 / math.sqrt(power + noise * noise))
    cross *= norm * norm
    correlation = numerator = denominator = zero
    for k in range(len(weight)):
        bk = b[k] * norm
        gk = g[k] * norm - bk * cross
        correlation += weight[k] * a[k] * bk
        numerator += weight[k] * gk * (a[k] - bk)
        denominator += weight[k] * gk * gk
    terms[0], terms[1], terms[2] = correlation, numerator, denominator
