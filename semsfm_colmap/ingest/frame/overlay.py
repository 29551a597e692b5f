"""Burnt-in writing over the image: logos, labels, scale bars, a databar without an edge.

What is drawn into every frame has the same value in all of them to the last digit, while the image
below it carries noise that differs from frame to frame. Saturated and clipped areas are constant,
too; unlike writing they have soft edges. So writing is: constant over the frames, and in sharp
contrast to its immediate surroundings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Bool

MIN_FRAMES = 4
"""With fewer frames, values agree by chance too often."""
EXACT = 1
LOSSY = 12
"""Grey levels by which a drawn value may differ between frames: stored exactly, or with loss."""
CONTRAST = 60
"""Grey levels between writing and its surroundings."""
SURROUNDINGS_PX = 15
MAX_CONSTANT = 0.2
"""If more of the pixels that are neither black nor white are constant, the frames are copies."""
MAX_WRITING = 0.15
GROW_PX = 3
MIN_INK_PX = 12
LINE_GAP_PX = 40
"""Writing of a borderless databar has no larger vertical gaps than this."""


class ConstantPixels:
    """Running minimum and maximum of frames (H, W) of one size, as 8-bit levels."""

    def __init__(self) -> None:
        self.low: Array | None = None
        self.high: Array | None = None
        self.count = 0
        self.lossy = False

    def add(self, levels: Array, *, lossy: bool) -> None:
        """Take one more frame into account."""
        self.count += 1
        self.lossy |= lossy
        if self.low is None or self.high is None:
            self.low, self.high = levels.copy(), levels.copy()
        else:
            np.minimum(self.low, levels, out=self.low)
            np.maximum(self.high, levels, out=self.high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlay:
    """Where writing is burnt in, (H, W) True there, and the first row of a databar without edge."""

    writing: Bool
    databar_row: int | None = None


def find_overlay(frames: ConstantPixels) -> Overlay | None:
    """Burnt-in writing of a series, or None if there is none or no telling."""
    import cv2

    if frames.count < MIN_FRAMES or frames.low is None or frames.high is None:
        return None
    low, high = frames.low, frames.high
    constant = (high - low) <= (LOSSY if frames.lossy else EXACT)
    inside = (low > 5) & (high < 250)
    if inside.any() and constant[inside].mean() > MAX_CONSTANT:
        return None
    middle = ((low.astype(np.uint16) + high) // 2).astype(np.uint8)
    around = cv2.medianBlur(middle, SURROUNDINGS_PX)
    ink = constant & (np.abs(middle.astype(np.int16) - around) >= CONTRAST) & _sharp(middle)
    count, labels, _, _ = cv2.connectedComponentsWithStats(
        cv2.dilate(ink.astype(np.uint8), np.ones((2 * GROW_PX + 1,) * 2, np.uint8)), connectivity=8
    )
    inked = np.bincount(labels.ravel(), weights=ink.ravel(), minlength=count)
    keep = inked >= MIN_INK_PX
    keep[0] = False
    writing = keep[labels]
    if not writing.any() or writing.mean() > MAX_WRITING:
        return None
    return Overlay(writing=writing, databar_row=_borderless_databar(writing, constant))


def _sharp(middle: Array) -> Bool:
    """Pixels with a neighbour that differs by most of the contrast of writing."""
    import cv2

    kernel = np.ones((5, 5), np.uint8)
    rise = cv2.dilate(middle, kernel).astype(np.int16) - cv2.erode(middle, kernel)
    return np.asarray(rise >= CONTRAST)


def _borderless_databar(writing: Bool, constant: Bool) -> int | None:
    """First row of lines of writing at the bottom on a background that is constant throughout."""
    height = len(writing)
    rows = np.flatnonzero(writing.any(axis=1))
    if height - rows[-1] > 0.08 * height:
        return None
    gaps = np.flatnonzero(np.diff(rows) > LINE_GAP_PX)
    first = int(rows[gaps[-1] + 1]) if len(gaps) else int(rows[0])
    wide = np.flatnonzero(writing[first:].any(axis=0))
    if height - first > 0.25 * height or wide[-1] - wide[0] < 0.5 * writing.shape[1]:
        return None
    if constant[first:].mean() < 0.8:
        return None
    return first
