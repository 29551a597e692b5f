"""Any depth to 8-bit grey."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array

MAX_SAMPLE = 2_000_000
"""Pixels from which the percentiles of a deep image are taken: plenty for 0.1 %."""


def to_grey8(pixels: Array, percentiles: tuple[float, float]) -> tuple[Array, tuple[float, float]]:
    """Map (H, W) of any depth to uint8; also returns the grey values that became 0 and 255.

    8-bit images are left as they are. Deeper ones rarely use their range (12 bits in 16, a few hot
    pixels at the top), so robust percentiles define it.
    """
    if pixels.dtype == np.uint8:
        return pixels, (0.0, 255.0)
    step = max(1, int(np.ceil((pixels.size / MAX_SAMPLE) ** 0.5)))
    sample = pixels[::step, ::step].astype(np.float64)
    low, high = (float(v) for v in np.percentile(sample, percentiles))
    if not high > low:
        low, high = float(pixels.min()), float(pixels.max())
    scale = 255.0 / (high - low) if high > low else 0.0
    scaled = (pixels.astype(np.float32) - np.float32(low)) * np.float32(scale)
    return np.rint(np.clip(scaled, 0.0, 255.0)).astype(np.uint8), (low, high)
