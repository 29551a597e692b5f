"""Detectors with Laplacian scale selection: Harris-, Hessian- and edge-Laplace.

A point is found in space by its own strength at each scale, and kept at the scales where the
normalised Laplacian ``sigma^2 (Lxx + Lyy)`` at that point is extremal (Lindeberg, IJCV 30, 1998;
Mikolajczyk and Schmid, IJCV 60, 2004). On a disk of radius r the blob detectors answer at its
centre with sigma = r / sqrt(2).

- Harris: ``det(mu) - 0.04 trace(mu)^2`` of the second-moment matrix, derivatives at
  sigma / sqrt(2), averaged over sigma.
- Hessian: ``sigma^4 det H``.
- edge: gradient magnitude, maximal along the gradient.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import Regions, circular_regions, concatenate
from semsfm_colmap.features.scale_space import BASE_SIGMA, LEVELS, Octave, ScaleSpace
from semsfm_colmap.types import Array

HARRIS_ID, HESSIAN_ID, EDGE_ID = 0, 1, 2
HARRIS_KAPPA = 0.04
"""Harris and Stephens 1988"""
KINDS = {"harris": HARRIS_ID, "hessian": HESSIAN_ID, "edge": EDGE_ID}


def detect_laplace(
    space: ScaleSpace, kinds: Iterable[str], options: DetectorOptions
) -> dict[str, Regions]:
    """Regions of several kinds from one scale space: the Laplacian is computed once."""
    kinds = tuple(kinds)
    found: dict[str, list[Regions]] = {kind: [] for kind in kinds}
    for octave in space.octaves:
        for kind, regions in _detect_octave(octave, kinds, options):
            found[kind].append(regions)
    return {kind: concatenate(parts) for kind, parts in found.items()}


def _detect_octave(
    octave: Octave, kinds: tuple[str, ...], options: DetectorOptions
) -> list[tuple[str, Regions]]:
    from semsfm_colmap.features.kernels import (
        hessian_maps,
        scale_selected_edges,
        scale_selected_maxima,
    )

    sigmas = [BASE_SIGMA * 2.0 ** (s / LEVELS) for s in range(-1, LEVELS + 1)]
    maps = [hessian_maps(octave.level(s), sigmas[s + 1]) for s in range(-1, LEVELS + 1)]
    minimum = options.laplacian_threshold
    out = []
    for s in range(LEVELS):
        sigma = sigmas[s + 1]
        laplacian = (maps[s][1], maps[s + 1][1], maps[s + 2][1])
        for kind in kinds:
            if kind == "hessian":
                rows = scale_selected_maxima(
                    maps[s + 1][0], *laplacian, options.hessian_threshold, minimum
                )
            elif kind == "harris":
                strength = harris_map(octave, s)
                rows = scale_selected_maxima(
                    strength, *laplacian, options.harris_threshold, minimum
                )
            else:
                rows = scale_selected_edges(
                    octave.level(s), sigma, *laplacian, options.edge_threshold, minimum
                )
            scale = octave.step * sigma * 2.0 ** (rows[:, 2] / LEVELS)
            xy = octave.step * rows[:, :2] + octave.offset
            regions = circular_regions(xy, scale, rows[:, 3], KINDS[kind])
            out.append((kind, regions.select(scale <= options.max_scale_px)))
    return out


def harris_map(octave: Octave, s: int) -> Array:
    """Cornerness at level s: (h, w)."""
    import cv2

    from semsfm_colmap.features.kernels import cornerness, gradient_products

    sigma = BASE_SIGMA * 2.0 ** (s / LEVELS)
    products = gradient_products(octave.level(s - 2), sigma / math.sqrt(2.0))
    half = math.ceil(3.0 * sigma)
    averaged = cv2.GaussianBlur(
        products, (2 * half + 1, 2 * half + 1), sigma, borderType=cv2.BORDER_REFLECT
    )
    return np.asarray(cornerness(averaged, HARRIS_KAPPA))
