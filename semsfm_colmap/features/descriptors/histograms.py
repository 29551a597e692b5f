"""Histograms of gradient directions over a layout of places: SIFT, GLOH, shape context.

Every sample of the patch spreads its gradient magnitude over the two nearest directions and over
up to four places with weights that the layout fixes once and for all.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from semsfm_colmap.features.descriptors.histogram_kernels import gradient_histograms
from semsfm_colmap.types import Array, Float, Int

CLIP = 0.2
"""Largest entry before the second normalisation [Lowe 2004]."""
GLOH_RADII = (6.0 / 15.0, 11.0 / 15.0)
"""Inner radii of the two outer rings of a patch of radius 1 (Mikolajczyk and Schmid 2005)."""
CONTEXT_EDGE_SHARE = 1.0
"""Edge points of the shape context are gradient maxima above this share of the patch's mean."""


def sift(patches: Array) -> Array:
    """4 x 4 places, 8 directions [Lowe 2004]: (K, 32, 32) -> (K, 128), length 1.

    The places cover the middle three quarters of the patch; a Gaussian window of half their width
    weighs the samples.
    """
    histogram = _histogram(patches, *_square_layout(patches.shape[1], 4, 0.75), 16, 8)
    return _clipped_unit(histogram)


def rootsift(patches: Array) -> Array:
    """SIFT under the Hellinger kernel: square root of the sum-normalised histogram.

    Arandjelovic and Zisserman, CVPR 2012: (K, 32, 32) -> (K, 128), length 1.
    """
    histogram = sift(patches)
    total = np.maximum(histogram.sum(axis=1, keepdims=True), 1e-12)
    return np.asarray(np.sqrt(histogram / total))


def gloh(patches: Array) -> Array:
    """Log-polar places, 1 + 2 x 8, and 16 directions (Mikolajczyk and Schmid, PAMI 2005).

    (K, P, P) -> (K, 272), length 1, before the principal components.
    """
    layout = _polar_layout(patches.shape[1], GLOH_RADII, 8, True)
    return _clipped_unit(_histogram(patches, *layout, 17, 16))


def shape_context(patches: Array) -> Array:
    """Edge points by place and direction (Belongie 2002, as in Mikolajczyk and Schmid 2005).

    A log-polar layout of 1 + 2 x 4 places and 4 directions, edge points weighted by their gradient:
    (K, P, P) -> (K, 36), length 1.
    """
    layout = _polar_layout(patches.shape[1], GLOH_RADII, 4, True)
    histogram = _histogram(patches, *layout, 9, 4, edge_share=CONTEXT_EDGE_SHARE)
    # square roots, so that one long edge does not outweigh the rest
    histogram = np.sqrt(histogram)
    return np.asarray(histogram / np.maximum(np.linalg.norm(histogram, axis=1)[:, None], 1e-12))


def _histogram(
    patches: Array,
    place: Int,
    weight: Array,
    num_places: int,
    num_directions: int,
    *,
    edge_share: float = 0.0,
) -> Array:
    return np.asarray(
        gradient_histograms(patches, place, weight, num_places, num_directions, edge_share)
    )


def _clipped_unit(histogram: Array) -> Array:
    """Unit length, entries clipped, unit length again; flat patches stay zero."""
    unit = histogram / np.maximum(np.linalg.norm(histogram, axis=1, keepdims=True), 1e-12)
    np.minimum(unit, CLIP, out=unit)
    unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-12)
    return np.asarray(unit)


def _coordinates(size: int) -> tuple[Float, Float]:
    """x, y (size, size) of the samples, the patch being [-1, 1]."""
    g = (2.0 * np.arange(size) + 1.0) / size - 1.0
    return np.broadcast_to(g[None, :], (size, size)), np.broadcast_to(g[:, None], (size, size))


@lru_cache(maxsize=8)
def _square_layout(size: int, num: int, share: float) -> tuple[Int, Array]:
    """Bilinear weights to num x num places that cover `share` of the patch's width."""
    x, y = _coordinates(size)
    place = np.zeros((size, size, 4), dtype=np.int64)
    weight = np.zeros((size, size, 4), dtype=np.float32)
    window = np.exp(-(x**2 + y**2) / (2.0 * share**2))
    column, row = ((v / share + 1.0) * num / 2.0 - 0.5 for v in (x, y))
    for n, (dy, dx) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        c, r = np.floor(column).astype(int) + dx, np.floor(row).astype(int) + dy
        w = (1.0 - np.abs(column - c)) * (1.0 - np.abs(row - r)) * window
        ok = (c >= 0) & (c < num) & (r >= 0) & (r < num)
        place[..., n] = np.where(ok, r * num + c, 0)
        weight[..., n] = np.where(ok, w, 0.0)
    return place, weight


@lru_cache(maxsize=8)
def _polar_layout(
    size: int, radii: tuple[float, float], num_angles: int, centre: bool
) -> tuple[Int, Array]:
    """Weights to one central place and two rings of `num_angles` sectors, bilinear in both.

    Rings blend linearly over the radius between their middles.
    """
    x, y = _coordinates(size)
    radius = np.hypot(x, y)
    middles = (0.5 * radii[0], 0.5 * (radii[0] + radii[1]), 0.5 * (radii[1] + 1.0))
    ring = np.interp(radius, middles, (0.0, 1.0, 2.0))
    sector = np.mod(np.arctan2(y, x) * num_angles / (2.0 * np.pi), num_angles)
    place = np.zeros((size, size, 4), dtype=np.int64)
    weight = np.zeros((size, size, 4), dtype=np.float32)
    for n, (dr, da) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        r = np.minimum(np.floor(ring).astype(int) + dr, 2)
        a = np.floor(sector).astype(int) + da
        wr = np.where(dr == 0, 1.0 - (ring - np.floor(ring)), ring - np.floor(ring))
        wa = np.where(da == 0, 1.0 - (sector - np.floor(sector)), sector - np.floor(sector))
        place[..., n] = np.where(r == 0, 0, 1 + (r - 1) * num_angles + a % num_angles)
        weight[..., n] = np.where(radius <= 1.0, wr * wa, 0.0)
    return place, weight
