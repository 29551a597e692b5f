"""A reference and its neighbours at one size: everything that the kernels need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.surface.stereo.rasters import Raster
from semsfm_colmap.surface.stereo.views import AffineSweep, affine_sweep
from semsfm_colmap.types import Array, Bool, Float, Int, Reconstruction


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """V neighbours of a reference, the mean grey of the reference subtracted."""

    mean_grey: float
    """What was subtracted"""
    grey: Array
    """(H, W) float32"""
    usable: Bool
    """(H, W)"""
    views: Array
    """(V, H', W') float32, padded to a common size"""
    view_usable: Array
    """(V, H', W') uint8"""
    sweep: AffineSweep
    """from the reference's px to those of each neighbour"""
    noise: Float
    """(1 + V,) deviations of the pixel noise, the reference's first"""
    contrast: float
    """Range of the reference's grey values."""
    unit: float
    """World units per px."""
    scaling: Float
    """(2,) Size of the level over that of the reference's image"""


def read_level(
    reconstruction: Reconstruction, reference: int, neighbors: Int, reader: Callable[[int], Raster]
) -> Level:
    """Read the reference and its neighbours, pad the neighbours to one size."""
    rasters = [reader(int(j)) for j in neighbors]
    ref = reader(reference)
    sizes = reconstruction.image_size_px
    scaling = np.ones((reconstruction.num_images, 2))
    for j, raster in zip([reference, *neighbors.tolist()], [ref, *rasters], strict=True):
        scaling[j] = np.array(raster.grey.shape[::-1]) / sizes[j]
    height = max(r.grey.shape[0] for r in rasters)
    width = max(r.grey.shape[1] for r in rasters)
    mean = np.float32(ref.grey.mean())
    views = np.zeros((len(rasters), height, width), dtype=np.float32)
    usable = np.zeros(views.shape, dtype=np.uint8)
    for j, raster in enumerate(rasters):
        h, w = raster.grey.shape
        views[j, :h, :w] = raster.grey - mean
        usable[j, :h, :w] = raster.usable
    low, high = np.percentile(ref.grey[::4, ::4], [1.0, 99.0])
    scale = reconstruction.cameras.scale_px_per_unit[reference] * scaling[reference].mean()
    return Level(
        mean_grey=float(mean),
        grey=ref.grey - mean,
        usable=ref.usable,
        views=views,
        view_usable=usable,
        sweep=affine_sweep(reconstruction.cameras, reference, neighbors, scaling),
        noise=np.array([max(r.noise, 0.25) for r in [ref, *rasters]]),
        contrast=max(float(high - low), 1.0),
        unit=float(1.0 / scale),
        scaling=scaling[reference],
    )
