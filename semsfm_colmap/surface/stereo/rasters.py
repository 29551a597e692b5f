"""Prepared images and masks at the size of the depth maps, as zero-mean float32."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.pixel_noise import quiet_noise_level
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.surface.stereo.undrift import drift_of, without_drift
from semsfm_colmap.types import Array, Bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Raster:
    """One image, resized, its usable pixels, and the deviation of its pixel noise."""

    grey: Array
    """(H, W) float32"""
    usable: Bool
    """(H, W)"""
    noise: float


def scaled_size(width: int, height: int, max_size_px: int) -> tuple[int, int]:
    """Width and height after shrinking the longer side to at most `max_size_px`."""
    factor = min(1.0, max_size_px / max(width, height))
    return max(1, round(width * factor)), max(1, round(height * factor))


def read_raster(
    image_path: Path,
    mask_path: Path | None,
    name: str,
    max_size_px: int,
    size: tuple[int, int],
    drift_px: tuple[float, float] = (0.0, 0.0),
) -> Raster:
    """Read one prepared image, without its scan drift.

    Parameters
    ----------
    size : width and height that the reconstruction knows
    drift_px : of the last row against the first, see `undrift.without_drift`

    """
    import cv2

    path = image_path / name
    grey = read_image(path, size)
    target = scaled_size(*size, max_size_px)
    straight = without_drift(grey.astype(np.float32), drift_px)
    small = cv2.resize(straight, target, interpolation=cv2.INTER_AREA)
    usable = np.ones(small.shape, dtype=bool)
    mask_file = None if mask_path is None else mask_path / f"{name}.png"
    if mask_file is not None and mask_file.exists():
        mask = read_grey(mask_file)
        if mask.shape != grey.shape:
            raise InputError(f"{mask_file} is not a mask of the size of {path}: delete or redo it.")
        mask = without_drift((mask > 0).astype(np.float32), drift_px, nearest=True)
        shrunk = cv2.resize(mask, target, interpolation=cv2.INTER_AREA)
        usable = shrunk > 0.5
    return Raster(grey=small, usable=usable, noise=quiet_noise_level(small))


def read_image(path: Path, size: tuple[int, int]) -> Array:
    """One prepared image (H, W), as its file has it.

    Parameters
    ----------
    size : width and height that the reconstruction knows

    """
    grey = read_grey(path)
    if (grey.shape[1], grey.shape[0]) != tuple(size):
        raise InputError(
            f"{path} is {grey.shape[1]} x {grey.shape[0]} px but the reconstruction says "
            f"{size[0]} x {size[1]} px: use the images that it was made from."
        )
    return grey


def raster_reader(
    image_path: Path,
    mask_path: Path | None,
    names: tuple[str, ...],
    sizes: Array,
    max_size_px: int,
    num_cached: int,
    drift_px: Array | None = None,
) -> Callable[[int], Raster]:
    """A function from image index to raster that keeps the `num_cached` used last.

    `drift_px` (M, 2) is the scan drift of each image, which is taken out.
    """

    @lru_cache(maxsize=num_cached)
    def read(idx: int) -> Raster:
        width, height = (int(v) for v in sizes[idx])
        drift = drift_of(drift_px, idx)
        return read_raster(image_path, mask_path, names[idx], max_size_px, (width, height), drift)

    return read
