"""Find the burnt-in databar: the strip of text that a microscope writes below the image.

A databar is drawn, not measured: each of its rows is mostly one exact grey value, the background
of the bar or a line, and the rest is text and logos in sharp contrast to it. An image row is
covered with noise and shading and has no such majority. So, from the bottom row upwards, rows are
taken as long as they look drawn; the strip counts as a databar only if

- it ends at the top in a straight edge across the full width: a row of one value below a row
  that is not drawn or that has a clearly different value, and
- it holds writing below that edge: enough pixels far from its background, in several rows.

The first condition keeps the black surroundings of a specimen, which may also be one exact
value, from being taken for a databar: they end in the outline of the specimen. Some bars (Zeiss)
float a pixel or two above the bottom of the image.

A series is taken with one set-up, so the frames of one size vote (`agree_on_databar`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from semsfm_colmap.types import Array, Bool

MAX_FRACTION = 0.4
"""A databar takes at most this part of the height (TESCAN's, the tallest known, takes 0.19)."""
MIN_ROWS = 10
"""Fewer rows cannot hold legible text."""
SMALL_PART = 9
"""Of an image that was reduced since, so small a part of the height will do."""
MIN_BACKGROUND = 0.35
"""Part of a drawn row that has the background's value; dense text leaves about half."""
MIN_LINE = 0.93
"""Part of a row that has one value in a drawn line; a frame or separators may cross it."""
EDGE_CONTRAST = 30
"""Grey levels between the first row of a bar and a row of one value above it."""
INK_CONTRAST = 50
"""Grey levels between writing and background."""
INK_RANGE = (0.002, 0.5)
"""Part of the bar that is writing."""
MIN_INK_ROWS, MIN_SMALL_INK_ROWS = 6, 4
"""Rows of writing; of an image that was reduced fewer, a third of the bar."""
MIN_DRAWN_ROWS = 0.95
"""Part of the rows of a bar of known height that must look drawn."""
MAX_FLOAT = 0.012
"""Part of the height that image rows may take below a floating databar."""
MIN_COLOURED = 0.5
"""Part of the row of a coloured databar that is coloured: the writing in it may be white."""
LOSSY_TOLERANCE = 10
"""Grey levels by which JPEG compression moves a drawn value."""


def find_databar(pixels: Array, *, lossy: bool = False) -> int | None:
    """First row of the databar of one image, or None if it has none.

    `pixels` is (H, W) of any unsigned or float type; `lossy` says that the file was compressed
    with loss, so that drawn values are only nearly exact.
    """
    grey = to_levels(pixels)
    height, width = grey.shape
    if height < 4 * MIN_ROWS or width < 4 * MIN_ROWS:
        return None
    tolerance = LOSSY_TOLERANCE if lossy else 1
    least = min(MIN_ROWS, max(MIN_INK_ROWS, height // SMALL_PART))
    first = height - int(MAX_FRACTION * height)
    part = grey[first:].astype(np.int16)
    mode = np.array([_mode(row, tolerance) for row in part])
    fraction = (np.abs(part - mode[:, None]) <= tolerance).mean(axis=1)
    drawn = fraction >= MIN_BACKGROUND
    last = int(np.flatnonzero(drawn)[-1]) if drawn.any() else 0
    if len(part) - 1 - last > MAX_FLOAT * height:
        return None
    above = np.flatnonzero(~drawn[: last + 1])
    top = int(above[-1]) + 1 if len(above) else 0
    for row in range(top, last + 2 - least):
        if fraction[row] < MIN_LINE:
            continue
        below_image = row > 0 and row == top
        below_other_value = row > top and abs(mode[row] - mode[row - 1]) >= EDGE_CONTRAST
        if below_image or below_other_value:
            return first + row if _has_writing(part[row : last + 1], tolerance) else None
    return None


def coloured_databar(coloured: Bool) -> int | None:
    """First row of a databar in colour: rows at the bottom that are mostly coloured, or None.

    `coloured` (H, W) is True where colour is drawn into a grey image.
    """
    grey = np.flatnonzero(coloured.mean(axis=1) < MIN_COLOURED)
    first = int(grey[-1]) + 1 if len(grey) else 0
    rows = len(coloured) - first
    return first if MIN_ROWS <= rows <= MAX_FRACTION * len(coloured) else None


def looks_drawn(pixels: Array, row: int, *, lossy: bool = False) -> bool:
    """Whether nearly all rows from `row` on are mostly one value, as in a databar."""
    part = to_levels(pixels)[row:].astype(np.int16)
    if len(part) < MIN_ROWS:
        return False
    tolerance = LOSSY_TOLERANCE if lossy else 1
    mode = np.array([_mode(values, tolerance) for values in part])
    fraction = (np.abs(part - mode[:, None]) <= tolerance).mean(axis=1)
    return bool((fraction >= MIN_BACKGROUND).mean() >= MIN_DRAWN_ROWS)


def agree_on_databar(rows: Sequence[int | None]) -> int | None:
    """The row that most frames of one size and set-up agree on; None if most have no databar."""
    votes = Counter(rows)
    if not votes:
        return None
    row, count = max(votes.items(), key=lambda item: (item[1], item[0] is not None))
    return row if row is not None and 2 * count >= len(rows) else None


def _has_writing(bar: Array, tolerance: int) -> bool:
    ink = np.abs(bar - _mode(bar, tolerance)) >= INK_CONTRAST
    # A full-width line is no writing.
    ink = ink & (ink.mean(axis=1) < MIN_LINE)[:, None]
    rows = min(MIN_INK_ROWS, max(MIN_SMALL_INK_ROWS, len(bar) // 3))
    return bool(INK_RANGE[0] <= ink.mean() <= INK_RANGE[1] and (ink.sum(axis=1) >= 3).sum() >= rows)


def _mode(values: Array, tolerance: int) -> int:
    """The most frequent grey level, counting neighbours within the tolerance."""
    counts = np.bincount(values.ravel(), minlength=256)
    if tolerance > 1:
        counts = np.convolve(counts, np.ones(2 * tolerance + 1, dtype=np.int64), mode="same")
    return int(counts.argmax())


def to_levels(pixels: Array) -> Array:
    """Grey levels 0..255; deeper images by their full range, as the bar is drawn in its ends."""
    if pixels.dtype == np.uint8:
        return pixels
    low, high = float(pixels.min()), float(pixels.max())
    scale = 255.0 / (high - low) if high > low else 0.0
    return np.rint((pixels.astype(np.float32) - low) * scale).astype(np.uint8)
