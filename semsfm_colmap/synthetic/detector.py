"""From signal to grey values: beam profile, background, charging, gain, shot noise."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array, Float

BACKGROUND = 0.045
"""Grey value of the empty chamber behind the specimen."""
MEDIAN_GREY = 0.42
"""Grey value that the median of the specimen is exposed to."""
SHOULDER = 0.55
"""Grey value above which the display compresses instead of clipping."""
CHARGE_WIDTHS = 0.06
"""Way of the beam within which the charge it leaves decays along the line, in image widths."""
CHARGE_LINES = 3.0
"""Lines within which it decays at a place."""
CHARGE_DEPTH = 0.6
"""Share of the signal that a charge of the brightest parts takes."""
CHARGE_GLOW = 0.15
"""Standard deviation of the glow of a charged specimen across a frame, relative to the signal."""


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
    charging: float = 0.0,
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
    charging : 0 to 1, see `charged`

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
    if charging > 0:
        grey = charged(grey, charging, rng)
    if counts > 0:
        per_grey = counts / 0.4
        # The beam current wavers from line to line.
        line = 1.0 + 0.006 * rng.normal(size=(height, 1))
        grey = rng.poisson(np.maximum(grey * line, 0.0) * per_grey) / per_grey
    return np.asarray(np.rint(255.0 * compressed(grey)), dtype=np.uint8)


def charged(grey: Array, strength: float, rng: np.random.Generator) -> Array:
    """Grey values (H, W) of a specimen that does not conduct.

    What emits much charges up and holds back what is emitted next: dark streaks behind bright parts
    along the scan line, fading over a few lines, and a glow across the frame that is another in
    each.
    """
    from scipy.signal import lfilter

    height, width = grey.shape
    along = np.exp(-1.0 / (CHARGE_WIDTHS * width))
    between = np.exp(-1.0 / CHARGE_LINES)
    streak = lfilter([1.0 - along], [1.0, -along], grey, axis=1)
    charge = lfilter([1.0 - between], [1.0, -between], streak, axis=0)
    charge = charge / max(float(np.percentile(charge, 99.0)), 1e-6)
    y, x = np.linspace(-1.0, 1.0, height)[:, None], np.linspace(-1.0, 1.0, width)[None]
    a, b, c = CHARGE_GLOW * rng.normal(size=3)
    factor = (1.0 - CHARGE_DEPTH * strength * charge) * (
        1.0 + strength * (a * x + b * y + c * x * y)
    )
    return np.asarray(grey * np.maximum(factor, 0.0), dtype=np.float32)


def compressed(grey: Float) -> Float:
    """Grey values in 0..1: linear up to SHOULDER, then bending smoothly toward 1."""
    room = 1.0 - SHOULDER
    over = np.maximum(grey - SHOULDER, 0.0)
    return np.asarray(np.minimum(grey, SHOULDER) + room * (1.0 - np.exp(-over / room)))
