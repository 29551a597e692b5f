"""Compiled kernel that sharpens a depth map: Gauss-Newton on windows of the surface."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from semsfm_colmap.surface.stereo.plane_kernels import EXACT, PIECE, span
from semsfm_colmap.surface.stereo.warp_kernels import (
    row_cells,
    row_places,
    row_usable,
    row_values,
)
from semsfm_colmap.types import Array


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def surface_step(
    reference: Array,
    lit: Array,
    surface: Array,
    views: Array,
    slopes: Array,
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
    depth: Array,
    score: Array,
    information: Array,
) -> None:
    """One Gauss-Newton step of every pixel's depth, in place.

    The neighbours are resampled into the reference's grid over the surface z, each pixel at its own
    depth, and a window moves as a whole. With a and b the weighted, centred and normalised greys of
    reference and neighbour, minimise over the offset of the window ``sum_j w_j |a - b_j|^2``, where
    ``db/dz = (I - b b^T) G / norm`` and G is the change of the neighbour's grey with depth. Samples
    whose grey differs from the centre's by `grey_cut` do not count (Yoon and Kweon 2006, with
    Tukey's weight): the window keeps to the centre's surface. A neighbour's weight falls with its
    correlation, to nothing at `spread` below the best one's: an occluded neighbour does not count.
    The step is shortened as if the surface had been known with the information `smoothness`.

    Everything follows from the nine sums ``sum w (a, b, G, a^2, b^2, G^2, a b, a G, b G)`` over a
    window, which run over a piece of a row at a time, one sample after the other.

    Parameters
    ----------
    reference : (H, W) float32
    lit : (V, H, W) float32, the reference in the light of each neighbour (`relight`)
    surface : (H, W) float32, the depths to start from, nan where there are none
    views, slopes : (V, H', W') float32, grey and its change with depth
    view_usable : (V, H', W') uint8
    B, c, e : the maps of `AffineSweep`
    window, window_weight : (K, 2) int64 offsets of the window's samples, (K,) float32
    noise : (1 + V,) deviations
    depth, score : (H, W) float32, overwritten: depth and mean correlation, nan and 0 where nothing
        is known, and at the border, where windows do not fit
    information : (H, W) float32, overwritten: inverse variance of the depth by the windows alone,
        per world unit squared; zero where no neighbour counts

    """
    H, W = reference.shape
    V, Hj, Wj = views.shape
    reach = np.abs(window).max()
    size = 2 * reach + 1
    depth[:] = np.nan
    score[:] = 0.0
    information[:] = 0.0
    known, filled = _known(surface)
    u, v = np.zeros(W, dtype=np.float32), np.zeros(W, dtype=np.float32)
    at, corner = np.zeros(W, dtype=np.uint32), np.zeros((4, W), dtype=np.float32)
    grey, slope = np.zeros((V, size, W), np.float32), np.zeros((V, size, W), np.float32)
    seen = np.zeros((V, size, W), dtype=np.float32)
    weight = np.zeros((len(window), PIECE), dtype=np.float32)
    total = np.zeros(PIECE, dtype=np.float32)
    sums = np.zeros((9, PIECE), dtype=np.float32)
    terms = np.zeros((V, 3, PIECE), dtype=np.float32)
    max_step = np.float32(0.5 / np.sqrt((c * c).sum(axis=1).max()))
    for y in range(H):
        slot = y % size
        for j in range(V):
            row_places(B[j], c[j], e[j], filled[y], y, u, v)
            row_cells(u, v, Hj, Wj, reach, at, seen[j, slot])
            row_usable(view_usable[j], at, seen[j, slot])
            row_values(views[j], at, u, v, corner, grey[j, slot])
            row_values(slopes[j], at, u, v, corner, slope[j, slot])
        yc = y - reach
        if yc < reach:
            continue
        for start in range(reach, W - reach, PIECE):
            first, last = span(surface[yc], start, min(start + PIECE, W - reach))
            if first >= last:
                continue
            n = last - first
            total[:n] = np.float32(1e-12)
            for k in range(len(window)):
                dx, dy = window[k]
                near = slice(first + dx, last + dx)
                _window_weight(
                    reference[yc, first:last],
                    reference[yc + dy, near],
                    known[yc + dy, near],
                    np.float32(1.0 / grey_cut),
                    window_weight[k],
                    weight[k, :n],
                    total[:n],
                )
            for k in range(len(window)):
                _divide(weight[k, :n], total[:n])
            for j in range(V):
                sums[:, :n] = np.float32(0.0)
                for k in range(len(window)):
                    dx, dy = window[k]
                    near = slice(first + dx, last + dx)
                    row = (yc + dy) % size
                    _add_sample(
                        weight[k, :n], lit[j, yc + dy, near], grey[j, row, near],
                        slope[j, row, near], sums[0], sums[1], sums[2], sums[3], sums[4], sums[5],
                        sums[6], sums[7], sums[8],
                    )  # fmt: skip
                view_terms(sums, seen[j, yc % size, first:last], noise[0], noise[1 + j], terms[j])
            _move(
                terms,
                filled[yc, first:last],
                known[yc, first:last],
                np.float32(0.5 * len(window)),
                np.float32(spread),
                np.float32(smoothness),
                max_step,
                depth[yc, first:last],
                score[yc, first:last],
                information[yc, first:last],
            )


@numba.njit(nogil=True, fastmath=EXACT, cache=True)
def _known(surface: Array) -> tuple[Array, Array]:
    """1 where a depth is known and 0 elsewhere, and the depths with 0 where there are none."""
    known = np.isfinite(surface).astype(np.float32)
    return known, np.where(known > 0, surface, np.float32(0.0))


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _window_weight(
    centre: Array,
    other: Array,
    known: Array,
    inverse_cut: float,
    share: float,
    weight: Array,
    total: Array,
) -> None:
    """Weights of one sample of the windows of a piece of a row, in place, and their totals."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for x in range(len(centre)):
        t = (other[x] - centre[x]) * inverse_cut
        w = max(one - t * t, zero)
        weight[x] = w * w * share * known[x]
        total[x] += weight[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _divide(weight: Array, total: Array) -> None:
    for x in range(len(weight)):
        weight[x] /= total[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _add_sample(
    weight: Array, a: Array, b: Array, g: Array,
    sa: Array, sb: Array, sg: Array, saa: Array, sbb: Array, sgg: Array,
    sab: Array, sag: Array, sbg: Array,
) -> None:  # fmt: skip
    """Add one sample of the windows of a piece of a row to the sums over them, in place."""
    for x in range(len(weight)):
        wa, wb, wg = weight[x] * a[x], weight[x] * b[x], weight[x] * g[x]
        sa[x] += wa
        sb[x] += wb
        sg[x] += wg
        saa[x] += wa * a[x]
        sbb[x] += wb * b[x]
        sgg[x] += wg * g[x]
        sab[x] += wa * b[x]
        sag[x] += wa * g[x]
        sbg[x] += wb * g[x]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def view_terms(sums: Array, seen: Array, noise_a: float, noise_b: float, terms: Array) -> None:
    """Correlation, and numerator and denominator of the step, of one neighbour, in place.

    Of the centred sums; the correlation is -2 where the neighbour does not see the pixel.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    more_a, more_b = np.float32(noise_a * noise_a), np.float32(noise_b * noise_b)
    for x in range(len(seen)):
        a, b, g = sums[0, x], sums[1, x], sums[2, x]
        aa, bb = max(sums[3, x] - a * a, zero), max(sums[4, x] - b * b, zero)
        gg = max(sums[5, x] - g * g, zero)
        ab, ag, bg = sums[6, x] - a * b, sums[7, x] - a * g, sums[8, x] - b * g
        inverse_a = one / np.sqrt(aa + more_a)
        inverse_b2 = one / (bb + more_b)
        inverse = inverse_a * np.sqrt(inverse_b2)
        along = bg * inverse_b2
        terms[0, x] = seen[x] * (ab * inverse + np.float32(2.0)) - np.float32(2.0)
        terms[1, x] = seen[x] * ((ag - ab * along) * inverse - (bg - bb * along) * inverse_b2)
        terms[2, x] = seen[x] * max(gg - along * (bg + bg - bb * along), zero) * inverse_b2


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
def _move(
    terms: Array,
    surface: Array,
    known: Array,
    half_count: float,
    spread: float,
    smoothness: float,
    max_step: float,
    depth: Array,
    score: Array,
    information: Array,
) -> None:
    """The step of a piece of a row by what all neighbours say, in place."""
    zero, one, tiny = np.float32(0.0), np.float32(1.0), np.float32(1e-12)
    for x in range(len(surface)):
        best = zero
        for j in range(len(terms)):
            best = max(best, terms[j, 0, x])
        total = correlation = numerator = denominator = zero
        for j in range(len(terms)):
            w = max(one - (best - terms[j, 0, x]) / spread, zero)
            total += w
            correlation += w * terms[j, 0, x]
            numerator += w * terms[j, 1, x]
            denominator += w * terms[j, 2, x]
        if known[x] == zero or total <= zero:
            continue
        correlation /= total
        # 2 (1 - ncc) is the mean squared difference of normalised greys; about half of the
        # window's samples are independent
        difference = max(np.float32(2.0) * (one - correlation), np.float32(0.02))
        info = denominator * half_count / difference
        step: Any = numerator / (denominator + tiny)
        step = max_step if step > max_step else -max_step if step < -max_step else step
        depth[x] = surface[x] + step * info / (info + smoothness + tiny)
        score[x] = correlation
        information[x] = info
