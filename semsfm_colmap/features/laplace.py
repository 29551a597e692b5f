"""Detectors with Laplacian scale selection: Harris-, Hessian- and edge-Laplace.

A point is found in space by its own strength at each scale, and kept at the scales where the
normalised Laplacian ``sigma^2 (Lxx + Lyy)`` at that point is extremal (Lindeberg, IJCV 30, 1998;
Mikolajczyk and Schmid, IJCV 60, 2004). On a disk of radius r the blob detectors answer at its
centre with sigma = r / sqrt(2).

- Harris: ``det(mu) - 0.04 trace(mu)^2`` of the second-moment matrix, derivatives at
  sigma / sqrt(2), averaged over sigma.
- Hessian: ``sigma^4 det H``.
- edge: gradient magnitude, maximal along the gradient; the point stays where the edge is, and its
  scale is the one at which the Laplacian there is extremal most strongly (Mikolajczyk, Zisserman,
  Schmid, BMVC 2003). On the rim of a disk that is 1.13 r: an edge gets the scale of its
  curvature.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from semsfm_colmap.features.laplace_kernels import (
    cornerness,
    edge_points,
    gradient_products,
    hessian_maps,
    scale_selected_maxima,
)
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import Regions, circular_regions, concatenate
from semsfm_colmap.features.scale_space import BASE_SIGMA, LEVELS, Octave, ScaleSpace
from semsfm_colmap.types import Array, Float, Int

HARRIS_ID, HESSIAN_ID, EDGE_ID = 0, 1, 2
HARRIS_KAPPA = 0.04
"""Harris and Stephens 1988"""
KINDS = {"harris": HARRIS_ID, "hessian": HESSIAN_ID, "edge": EDGE_ID}


def detect_laplace(
    space: ScaleSpace, kinds: Iterable[str], options: DetectorOptions
) -> dict[str, Regions]:
    """Regions of several kinds from one scale space: the Laplacian is computed once."""
    kinds = tuple(kinds)
    blobs = [kind for kind in kinds if kind != "edge"]
    found: dict[str, list[Regions]] = {kind: [] for kind in kinds}
    laplacians: list[tuple[Array, ...]] = []
    for octave in space.octaves:
        laplacians.append(_detect_octave(octave, blobs, found, options))
    if "edge" in found:
        found["edge"].append(detect_edges(space, laplacians, options))
    return {kind: concatenate(parts) for kind, parts in found.items()}


def _detect_octave(
    octave: Octave,
    kinds: Sequence[str],
    found: dict[str, list[Regions]],
    options: DetectorOptions,
) -> tuple[Array, ...]:
    """Append the regions of an octave to `found`; returns the Laplacians of levels -1 .. LEVELS."""
    sigmas = [BASE_SIGMA * 2.0 ** (s / LEVELS) for s in range(-1, LEVELS + 1)]
    maps = [hessian_maps(octave.level(s), sigmas[s + 1]) for s in range(-1, LEVELS + 1)]
    laplacians = tuple(laplacian for _, laplacian in maps)
    thresholds = {"hessian": options.hessian_threshold, "harris": options.harris_threshold}
    for s in range(LEVELS):
        for kind in kinds:
            strength = maps[s + 1][0] if kind == "hessian" else harris_map(octave, s)
            rows = scale_selected_maxima(
                strength, *laplacians[s : s + 3], thresholds[kind], options.laplacian_threshold
            )
            scale = octave.step * sigmas[s + 1] * 2.0 ** (rows[:, 2] / LEVELS)
            xy = octave.step * rows[:, :2] + octave.offset
            regions = circular_regions(xy, scale, rows[:, 3], KINDS[kind])
            found[kind].append(regions.select(scale <= options.max_scale_px))
    return laplacians


def detect_edges(
    space: ScaleSpace, laplacians: Sequence[tuple[Array, ...]], options: DetectorOptions
) -> Regions:
    """Edge points of the first level of each octave with the scale of the Laplacian there.

    Parameters
    ----------
    laplacians : per octave those of levels -1 .. LEVELS

    """
    import cv2

    parts = []
    for o, octave in enumerate(space.octaves):
        points = edge_points(octave.level(0), BASE_SIGMA, options.edge_threshold)
        if not len(points):
            continue
        xy = octave.step * points[:, :2] + octave.offset
        profile = []
        for coarser, levels in zip(space.octaves[o:], laplacians[o:], strict=True):
            at = ((xy - coarser.offset) / coarser.step).astype(np.float32)
            # levels 0 .. LEVELS - 1, and the one beyond where no octave follows
            last = LEVELS + 1 if coarser is not space.octaves[-1] else LEVELS + 2
            for level in levels[1:last]:
                profile.append(_interpolated(cv2, level, at))
        strength = np.abs(np.stack(profile, axis=1))
        chosen, position, peak = strongest_maximum(strength)
        chosen = chosen[peak >= options.laplacian_threshold]
        position = position[peak >= options.laplacian_threshold]
        scale = octave.step * BASE_SIGMA * 2.0 ** (position / LEVELS)
        regions = circular_regions(xy[chosen], scale, points[chosen, 2], EDGE_ID)
        parts.append(regions.select(scale <= options.max_scale_px))
    return concatenate(parts) if parts else _no_regions()


def _no_regions() -> Regions:
    return circular_regions(np.zeros((0, 2)), np.zeros(0), np.zeros(0), EDGE_ID)


def _interpolated(cv2: Any, image: Array, xy: Array) -> Array:
    """Values (K,) of an image at pixel indices (K, 2); as rows of at most 2^14, which cv2 takes."""
    side = 1 << 14
    values = [
        cv2.remap(
            image,
            xy[k : k + side, None],
            None,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )[:, 0]
        for k in range(0, len(xy), side)
    ]
    return np.concatenate(values)


def strongest_maximum(values: Array) -> tuple[Int, Float, Float]:
    """Largest interior local maximum along each row (K, L), refined by a parabola.

    Returns
    -------
    rows that have one, its position along the row, its value

    """
    middle = values[:, 1:-1]
    is_maximum = (middle > values[:, :-2]) & (middle >= values[:, 2:])
    rows = np.flatnonzero(is_maximum.any(axis=1))
    at = np.where(is_maximum[rows], middle[rows], -np.inf).argmax(axis=1) + 1
    low, mid, high = (values[rows, at + d].astype(np.float64) for d in (-1, 0, 1))
    bend = low + high - 2.0 * mid
    shift = np.where(bend < 0.0, 0.5 * (low - high) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return rows, at + np.clip(shift, -0.5, 0.5), mid


def harris_map(octave: Octave, s: int) -> Array:
    """Cornerness at level s: (h, w)."""
    import cv2

    sigma = BASE_SIGMA * 2.0 ** (s / LEVELS)
    products = gradient_products(octave.level(s - 2), sigma / math.sqrt(2.0))
    half = math.ceil(3.0 * sigma)
    averaged = cv2.GaussianBlur(
        products, (2 * half + 1, 2 * half + 1), sigma, borderType=cv2.BORDER_REFLECT
    )
    return np.asarray(cornerness(averaged, HARRIS_KAPPA))
