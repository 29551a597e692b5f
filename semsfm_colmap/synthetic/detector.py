"""From the signal of the specimen to grey values: beam profile, background, gain, shot noise."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array, Float

BACKGROUND = 0.045
"""Grey value of the empty chamber behind the specimen."""
MEDIAN_GREY = 0.42
"""Grey value that the median of the specimen is exposed to."""
SHOULDER = 0.55
"""Grey value above which the display compresses instead of clipping."""


def exposure_of(signal: Array, coverage: Array) -> float:
    """Factor from signal to grey value, from the first frame: fixed for the series."""
    on = signal[coverage > 0.99]
    return MEDIAN_GREY / float(np.median(on)) if on.size else MEDIAN_GREY


def expose(
    signal: Array,
    coverage: Array,
    *,
    exposure: float,
    gain: float,
    psf_px: float,
    counts: float,
    rng: np.random.Generator,
) -> Array:
    """Grey values (H, W) uint8 of one frame.

    Parameters
    ----------
    signal, coverage : (H, W) what the renderer returns
    exposure : factor of the series
    gain : factor of this frame
    psf_px : standard deviation of the beam profile
    counts : electrons per pixel at grey value 0.4; 0 for no noise
    rng : of this frame

    """
    import cv2

    height, width = signal.shape
    # Charge on the holder lights the chamber unevenly.
    y, x = np.linspace(-0.5, 0.5, height)[:, None], np.linspace(-0.5, 0.5, width)[None]
    chamber = BACKGROUND * (1.0 + 0.25 * y - 0.15 * x)
    lit = gain * (exposure * signal + (1.0 - coverage) * chamber)
    grey: Array = lit.astype(np.float32)
    if psf_px > 0:
        grey = cv2.GaussianBlur(grey, (0, 0), psf_px, borderType=cv2.BORDER_REFLECT)
    if counts > 0:
        per_grey = counts / 0.4
        # The beam current wavers from line to line.
        line = 1.0 + 0.006 * rng.normal(size=(height, 1))
        grey = rng.poisson(np.maximum(grey * line, 0.0) * per_grey) / per_grey
    return np.asarray(np.rint(255.0 * compressed(grey)), dtype=np.uint8)


def compressed(grey: Float) -> Float:
    """Grey values in 0..1: linear up to SHOULDER, then bending smoothly toward 1."""
    room = 1.0 - SHOULDER
    over = np.maximum(grey - SHOULDER, 0.0)
    return np.asarray(np.minimum(grey, SHOULDER) + room * (1.0 - np.exp(-over / room)))
