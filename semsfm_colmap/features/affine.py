"""Affine regions: second-moment adaptation of the shape of circular ones.

For each region the sampled ellipse is changed until the second-moment matrix inside it is a
multiple of the identity; see `patch_kernels.adapt_shapes`. The position is kept: it is already
located to a fraction of a pixel, and moving it with the shape costs repeatability more than it
brings accuracy (Perdoch, Chum, Matas, CVPR 2009, do the same).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.patch_kernels import adapt_shapes
from semsfm_colmap.features.regions import Regions
from semsfm_colmap.features.scale_space import ScaleSpace

DERIVATIVE_SHARE = 0.7
"""Smoothing under the derivatives, in scales of the region. The blur is round, and the more of it
there is, the rounder every region looks; 0.7 gave the most true matches at 20 degrees."""


def adapt(space: ScaleSpace, regions: Regions, options: DetectorOptions) -> Regions:
    """Regions with their affine shape; those that do not converge are dropped."""
    K = len(regions)
    shape = np.tile(np.eye(2), (K, 1, 1))
    good = np.zeros(K, dtype=bool)
    octave, level = space.nearest_level(DERIVATIVE_SHARE * regions.scale_px)
    for o, s in sorted(set(zip(octave.tolist(), level.tolist(), strict=True))):
        rows = np.flatnonzero((octave == o) & (level == s))
        grid = space.octaves[o]
        shape[rows], good[rows] = adapt_shapes(
            grid.level(s),
            (regions.xy[rows] - grid.offset) / grid.step,
            regions.scale_px[rows] / grid.step,
            options.affine_iterations,
            options.affine_convergence,
            options.max_anisotropy,
        )
    return replace(regions, shape=shape).select(good)
