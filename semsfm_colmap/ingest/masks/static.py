"""What does not move with the specimen: a static background, a substrate, a mount.

Where something stands still while the specimen turns, every frame shows the temporal median there.
So each frame is compared with the median of the series by normalised cross-correlation in small
windows, and the median of the first half of the series with that of the second. A pixel is static
where most frames agree with the median and both halves do; it moves where hardly any frame agrees.
Texture is needed to tell: flat regions are left to `foreground`.

Standing still proves nothing when nothing moves, and near the axis of a small tilt a specimen
hardly moves. So there is no answer for a short series, when hardly any of the texture moves, when
more of it is undecided than static, or when the two most different frames differ at the static
places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Bool, Float

WORK_SIDE_PX = 384
MIN_FRAMES = 6
WINDOW_PX = 13
"""Window of the correlation at the working size: a few features wide."""
SAME = 0.8
"""Correlation from which two windows show the same thing in the same place."""
SAME_HALVES = 0.85
IN_MOST = 0.5
"""A static pixel agrees with the median in at least this part of the frames: the specimen may hide
it in the others."""
IN_FEW = 0.2
"""A moving pixel agrees in less than this part."""
MIN_MOVING = 0.04
"""Part of the texture that must move."""
MIN_STATIC = 0.02
MAX_NOISE = 0.25
"""Spread, relative to that of the whole frame, from which any window counts as texture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticScene:
    """Per frame a mask, True where something moves or nothing is known; None with the reason."""

    masks: tuple[Bool, ...] | None
    reason: str = ""


def find_static(frames: Sequence[Array]) -> StaticScene:
    """Tell what stands still in frames (H, W) of one size, reduced, in acquisition order."""
    if len(frames) < MIN_FRAMES:
        return StaticScene(masks=None, reason=f"{MIN_FRAMES} frames are needed to see motion")
    small = np.stack([_standardised(frame) for frame in frames])
    median = np.median(small, axis=0)
    half = len(small) // 2
    halves = _correlation(np.median(small[:half], axis=0), np.median(small[half:], axis=0))
    agreement = np.stack([_correlation(frame, median) for frame in small])
    support = (agreement > SAME).mean(axis=0)
    textured = np.mean([_spread(frame) for frame in small], axis=0) > _noise(small)
    if textured.mean() < 0.01:
        return StaticScene(masks=None, reason="there is too little texture to see motion")
    still = textured & (support >= IN_MOST) & (halves >= SAME_HALVES)
    static = float(still.sum() / textured.sum())
    moving = float((textured & (support < IN_FEW)).sum() / textured.sum())
    if static < MIN_STATIC:
        return StaticScene(masks=None, reason="nothing stands still")
    apart = _most_different(small, textured)
    if moving < MIN_MOVING or 1 - static - moving > static or np.median(apart[still]) < SAME:
        return StaticScene(masks=None, reason="the specimen moves too little to tell it apart")
    masks = tuple(_usable(still, frame) > 0 for frame in agreement)
    return StaticScene(masks=masks)


def reduced(pixels: Array) -> Array:
    """8-bit pixels (H, W) at the size that `find_static` works at."""
    import cv2

    scale = min(1.0, WORK_SIDE_PX / max(pixels.shape))
    size = (max(8, round(pixels.shape[1] * scale)), max(8, round(pixels.shape[0] * scale)))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


def _most_different(small: Array, textured: Bool) -> Float:
    """Correlation map of the first frame with the one least like it."""
    maps = [_correlation(small[0], frame) for frame in small[1:]]
    return min(maps, key=lambda values: float(values[textured].mean()))


def _usable(still: Bool, agreement: Float) -> Array:
    """What to keep of one frame: all but the static places that show through in it."""
    import cv2

    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (WINDOW_PX, WINDOW_PX))
    small = np.ones((5, 5), np.uint8)
    place = cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_OPEN, small)
    ignore = (cv2.dilate(place, window) > 0) & (agreement > SAME)
    # Correlation is lost a window's width around the specimen: close the gap up to its edge.
    usable = cv2.morphologyEx((~ignore).astype(np.uint8), cv2.MORPH_OPEN, window)
    return np.asarray(cv2.dilate(usable, small))


def _standardised(frame: Array) -> Float:
    """Brightness and contrast of the frame removed, fine noise smoothed."""
    import cv2

    smooth = cv2.GaussianBlur(frame.astype(np.float32), (0, 0), 1.0)
    return np.asarray((smooth - smooth.mean()) / max(float(smooth.std()), 1e-3))


def _mean(values: Array) -> Float:
    import cv2

    return np.asarray(cv2.blur(values, (WINDOW_PX, WINDOW_PX)))


def _spread(frame: Array) -> Float:
    return np.asarray(np.sqrt(np.maximum(_mean(frame * frame) - _mean(frame) ** 2, 0)))


def _correlation(a: Array, b: Array) -> Float:
    """Normalised cross-correlation in windows."""
    covariance = _mean(a * b) - _mean(a) * _mean(b)
    return np.asarray(covariance / np.maximum(_spread(a) * _spread(b), 1e-4))


def _noise(small: Array) -> float:
    """Spread above which a window holds texture: some way above the flattest windows."""
    flat = float(np.percentile(np.stack([_spread(frame) for frame in small[:3]]), 5))
    return min(max(3.0 * flat, 0.1), MAX_NOISE)
