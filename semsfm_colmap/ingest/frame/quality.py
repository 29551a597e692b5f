"""Per-frame measures that tell a blurred, charged or differently lit frame from its neighbours.

Sharpness: the variance of a fine band-pass (difference of Gaussians), less what the pixel noise
contributes to it, relative to that of a coarse band-pass. Defocus lowers it; content and contrast
hardly change it from one frame to the next.

Charging shows as horizontal streaks (rows brighter or darker than those above and below, because
the charge builds up along the scan) and as saturated area. Both are compared with the series, as is
the mean level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.pixel_noise import noise_level
from semsfm_colmap.types import Array

FINE = (1.0, 2.0)
COARSE = (3.0, 6.0)
"""Standard deviations in px of the two Gaussians of each band-pass."""
BLURRED = 0.5
"""Sharpness relative to the neighbours below which a frame is called blurred."""
STREAKED = 3.0
"""Row streaks relative to the series' median above which a frame is called charged."""
MIN_STREAK = 3.0
"""Grey levels of row streaks that are always tolerated."""
SATURATED = 0.05
"""Saturated part of the image, above the series' median."""
BRIGHTNESS = 0.5
"""Relative difference of the mean level from the neighbours."""
NEIGHBOURS = 2
ROW_WINDOW = 31
"""Rows over which the trend of the row means is taken."""


@dataclass(frozen=True, kw_only=True)
class FrameQuality:
    """Measures of one frame."""

    level: float
    sharpness: float
    saturated: float
    streaks: float
    """Grey levels: 99th percentile of the row means' deviation from their running median."""


def measure(grey: Array) -> FrameQuality:
    """Measures of 8-bit pixels (H, W) without databar."""
    pixels = grey.astype(np.float32)
    fine, fine_gain = _band(pixels, *FINE)
    coarse, _ = _band(pixels, *COARSE)
    noise = noise_level(grey)
    detail = max(float(fine.var()) - noise**2 * fine_gain, 0.0)
    return FrameQuality(
        level=float(pixels.mean()),
        sharpness=detail / max(float(coarse.var()), 1e-6),
        saturated=float((grey >= 254).mean()),
        streaks=_streaks(pixels),
    )


def judge(frames: Sequence[FrameQuality]) -> tuple[list[str], ...]:
    """For each frame the sentences about it, compared with its neighbours and the series."""
    sharpness = np.array([f.sharpness for f in frames])
    level = np.array([f.level for f in frames])
    streaks = np.array([f.streaks for f in frames])
    saturated = np.array([f.saturated for f in frames])
    notes: list[list[str]] = []
    for i in range(len(frames)):
        near = [
            j for j in range(max(0, i - NEIGHBOURS), min(len(frames), i + NEIGHBOURS + 1)) if j != i
        ]
        said = []
        usual = float(np.median(sharpness[near])) if near else 0.0
        if usual > 0 and sharpness[i] < BLURRED * usual:
            said.append(f"blurred: {sharpness[i] / usual:.0%} of its neighbours' sharpness")
        if streaks[i] > max(MIN_STREAK, STREAKED * float(np.median(streaks))):
            said.append(f"charged: rows jump by {streaks[i]:.0f} grey levels")
        elif saturated[i] > float(np.median(saturated)) + SATURATED:
            said.append(f"charged: {saturated[i]:.0%} of it is saturated")
        usual = float(np.median(level[near])) if near else 0.0
        if usual > 0 and abs(level[i] / usual - 1) > BRIGHTNESS:
            said.append(f"brightness {level[i] / usual:.0%} of its neighbours'")
        notes.append(said)
    return tuple(notes)


def _band(pixels: Array, inner: float, outer: float) -> tuple[Array, float]:
    """Band-passed pixels and the variance it makes of white noise of variance 1."""
    import cv2

    band = cv2.GaussianBlur(pixels, (0, 0), inner) - cv2.GaussianBlur(pixels, (0, 0), outer)
    # Integral of the squared difference of two Gaussians of variances a, b.
    a, b = inner**2, outer**2
    gain = (1 / (2 * a) + 1 / (2 * b) - 2 / (a + b)) / (2 * np.pi)
    return np.asarray(band), float(gain)


def _streaks(pixels: Array) -> float:
    """How far row means stick out of their trend.

    The median over the columns' deviations is taken, as a streak runs across the whole image but a
    specimen's edge does not.
    """
    from scipy.ndimage import median_filter

    columns = pixels[:, :: max(1, pixels.shape[1] // 256)]
    blocks = np.array_split(columns, 8, axis=1)
    deviations = []
    for block in blocks:
        profile = block.mean(axis=1)
        window = min(ROW_WINDOW, len(profile) // 2 * 2 - 1)
        deviations.append(profile - median_filter(profile, size=window, mode="nearest"))
    across = np.median(deviations, axis=0)
    return float(np.percentile(np.abs(across), 99))
