"""Optional changes of the pixels before matching: flat field, denoising, local contrast.

The order is that of their causes: noise was added last by the detector, so it goes first; then the
slow change of brightness across the field; then the contrast is evened out. None is on by default:
features are invariant to most of what they remove.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.pixel_noise import noise_level
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.types import Array

CLAHE_TILE_PX = 64
NLM_PATCH_PX, NLM_SEARCH_PX = 5, 15
"""Sizes of patches and search window of non-local means [Buades, Coll, Morel 2005]."""


def changes_pixels(options: IngestOptions) -> bool:
    """Whether any of the changes is asked for."""
    return options.flat_field or options.denoise != "off" or options.local_contrast > 0


def prepare_pixels(grey: Array, options: IngestOptions) -> Array:
    """8-bit grey (H, W) -> 8-bit grey with the changes the options ask for."""
    if options.denoise != "off":
        grey = _denoised(grey, options.denoise)
    if options.flat_field:
        grey = _flattened(grey, options.flat_field_scale)
    if options.local_contrast > 0:
        grey = _evened(grey, options.local_contrast)
    return grey


def _denoised(grey: Array, method: str) -> Array:
    import cv2

    if method == "median":
        return np.asarray(cv2.medianBlur(grey, 3))
    if method == "gaussian":
        return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0))
    strength = max(noise_level(grey), 1.0)
    return np.asarray(
        cv2.fastNlMeansDenoising(
            grey, None, h=strength, templateWindowSize=NLM_PATCH_PX, searchWindowSize=NLM_SEARCH_PX
        )
    )


def _flattened(grey: Array, scale: float) -> Array:
    """Divide by the slow part of the brightness; the mean level is kept."""
    import cv2

    sigma = scale * max(grey.shape)
    field = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    level = float(field.mean())
    # The offset keeps a dark background from being blown up to the level of the specimen.
    gain = (level + 0.25 * level) / (field + 0.25 * level) if level > 0 else 1.0
    return np.asarray(np.rint(np.clip(grey * gain, 0, 255)).astype(np.uint8))


def _evened(grey: Array, clip: float) -> Array:
    """Contrast-limited adaptive histogram equalisation [Zuiderveld 1994]."""
    import cv2

    tiles = (max(1, grey.shape[1] // CLAHE_TILE_PX), max(1, grey.shape[0] // CLAHE_TILE_PX))
    return np.asarray(cv2.createCLAHE(clipLimit=clip, tileGridSize=tiles).apply(grey))
