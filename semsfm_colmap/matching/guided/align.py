"""Patches of reference views, aligned with other images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.matching.guided.align_kernels import align_all, prepare_all
from semsfm_colmap.matching.guided.patch_kernels import cut_patches
from semsfm_colmap.types import Array, Bool, Float, Int

PIXEL_CENTRE = 0.5
"""COLMAP's origin: the centre of the first pixel is (0.5, 0.5)."""
MAX_ITERATIONS = 14


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Patches found in an image."""

    xy: Float
    """(K, 2) px, nan where none was found"""
    correlation: Float
    covariance: Float
    """(K, 2, 2) px^2, up to a factor common to the series: neighbouring pixels share their noise"""

    @property
    def found(self) -> Bool:
        """(K,)"""
        return np.isfinite(self.xy[:, 0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Templates:
    """Patches of reference views, with all that aligning them needs to be computed once."""

    window: Array
    gradient: Array
    texture: Array
    inverse: Float
    spread: Float
    contrast: Float
    """(K,) 0 where a patch has left its image or shows too little"""

    @property
    def usable(self) -> Bool:
        """(K,)"""
        return np.asarray(self.contrast > 0.0)


def gaussian_window(radius: int, sigma: float) -> Array:
    """(n, n) float64, n = 2 radius + 1; zero on the rim, which serves for gradients only."""
    g = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    g[[0, -1]] = 0.0
    return np.outer(g, g)


def read_patches(image: Array, xy: Float, radius: int) -> Array:
    """Patches (K, n, n) float32 around places, n = 2 radius + 1; nan where they leave the image."""
    return np.asarray(cut_patches(image, np.ascontiguousarray(xy - PIXEL_CENTRE), radius))


def prepare_templates(patches: Array, window_sigma_px: float) -> Templates:
    """Patches (K, n, n), nan where there is none, made ready for alignment."""
    window = gaussian_window((patches.shape[1] - 1) // 2, window_sigma_px)
    gradient, texture, inverse, spread, contrast = prepare_all(
        np.ascontiguousarray(patches), window
    )
    return Templates(
        window=window,
        gradient=gradient,
        texture=texture,
        inverse=inverse,
        spread=spread,
        contrast=contrast,
    )


def align_patches(
    templates: Templates,
    which: Int,
    image: Array,
    xy: Float,
    warp: Float,
    *,
    max_shift_px: float,
    min_correlation: float,
) -> Alignment:
    """Find patches near their predicted places, see `align_kernels`.

    Parameters
    ----------
    which : (K,) numbers of the templates to find
    image : float32, filtered as the reference views were
    xy, warp : (K, 2) px and (K, 2, 2), predicted

    """
    out = align_all(
        np.ascontiguousarray(which),
        templates.gradient,
        templates.texture,
        templates.inverse,
        templates.spread,
        templates.contrast,
        templates.window,
        image,
        np.ascontiguousarray(xy - PIXEL_CENTRE),
        np.ascontiguousarray(warp),
        MAX_ITERATIONS,
        max_shift_px,
    )
    out[~(out[:, 2] >= min_correlation)] = np.nan
    return Alignment(
        xy=out[:, :2] + PIXEL_CENTRE,
        correlation=out[:, 2],
        covariance=out[:, [3, 4, 4, 5]].reshape(-1, 2, 2),
    )
