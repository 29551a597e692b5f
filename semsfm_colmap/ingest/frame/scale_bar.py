"""Length in pixels of a scale bar drawn in the databar.

A scale bar is a horizontal stroke in the writing's colour that ends at two marks (ticks, arrow
heads) or on its own, sometimes interrupted by its label in the middle. Frames and separators of the
databar are strokes too; they end at lines that cross the whole databar, or run across the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from semsfm_colmap.ingest.frame.databar import INK_CONTRAST
from semsfm_colmap.types import Array, Bool

MIN_PART = 0.02
"""Shortest scale bar relative to the image width."""
MAX_PART = 0.8
MAX_STROKE_PX = 12
MAX_LABEL_PART = 0.6
"""Part of the length that the label may take out of the stroke's middle."""
CROSSING = 0.6
"""A line that crosses this part of the databar's height is a separator."""
AGREEMENT = 0.02
"""Relative error of a measured bar: a pixel at either end of some 100."""


@dataclass(frozen=True, kw_only=True)
class ScaleBar:
    """A drawn scale bar: its length, between the middles of its end marks where it has any."""

    length_px: float
    has_marks: bool


def find_scale_bar(bar: Array) -> ScaleBar | None:
    """The scale bar in the rows of a databar (h, W), 8-bit; None if no stroke looks like one."""
    if bar.ndim != 2 or min(bar.shape) < 8:
        return None
    background = int(np.bincount(bar.ravel(), minlength=256).argmax())
    ink = np.abs(bar.astype(np.int16) - background) >= INK_CONTRAST
    separators = ink.mean(axis=0) >= CROSSING
    ink[ink.mean(axis=1) >= 0.93] = False
    best: ScaleBar | None = None
    for row in range(ink.shape[0]):
        for first, last in _strokes(ink[row]):
            found = _judge(ink, separators, row, first, last)
            if found and (best is None or _rank(found) > _rank(best)):
                best = found
    return best


def _rank(found: ScaleBar) -> tuple[bool, float]:
    return found.has_marks, found.length_px


def _strokes(row: Bool) -> list[tuple[int, int]]:
    """Runs of ink in a row, and pairs of runs with room for a label between them."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    width = len(row)
    shortest = MIN_PART * width
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    single = [(a, b) for a, b in runs if shortest <= b - a + 1 <= MAX_PART * width]
    arms = [(a, b) for a, b in runs if b - a + 1 >= 0.5 * shortest]
    double = [
        (left[0], right[1])
        for left, right in pairwise(arms)
        if right[0] - left[1] <= MAX_LABEL_PART * (right[1] - left[0])
        and abs((left[1] - left[0]) - (right[1] - right[0])) <= 0.1 * (right[1] - left[0])
        and right[1] - left[0] + 1 <= MAX_PART * width
    ]
    return single + double


def _judge(ink: Bool, separators: Bool, row: int, first: int, last: int) -> ScaleBar | None:
    """Whether a stroke is a scale bar: thin, not between separators; with its length."""
    near = 2
    for end in (first, last):
        if separators[max(0, end - near) : end + near + 1].any():
            return None
    # Only the topmost row of a stroke is judged; its thickness is that of most of its columns.
    if row and ink[row - 1, first : last + 1].mean() > 0.9:
        return None
    quarter = max(1, (last - first) // 8)
    inner = np.concatenate(
        [np.arange(first + quarter // 2, first + quarter), np.arange(last - quarter, last)]
    )
    thickness = int(np.median([_extent(ink[:, c], row) for c in inner])) if len(inner) else 1
    if thickness > min(MAX_STROKE_PX, (last - first) / 4):
        return None
    marks = [
        _mark_columns(ink, row, end, thickness, step) for end, step in ((first, 1), (last, -1))
    ]
    has_marks = all(len(columns) for columns in marks)
    if has_marks:
        length = abs(float(np.mean(marks[1])) - float(np.mean(marks[0])))
    else:
        length = float(last - first + 1)
    return ScaleBar(length_px=length, has_marks=has_marks)


def _extent(column: Bool, row: int) -> int:
    """Rows of connected ink in a column around a row."""
    top = row
    while top > 0 and column[top - 1]:
        top -= 1
    bottom = row
    while bottom + 1 < len(column) and column[bottom + 1]:
        bottom += 1
    return bottom - top + 1


def _mark_columns(ink: Bool, row: int, end: int, thickness: int, step: int) -> list[int]:
    """Columns of an upright tick at an end of a stroke; empty if there is none."""
    columns = []
    for offset in range(4):
        column = end + step * offset
        if not 0 <= column < ink.shape[1]:
            break
        extent = _extent(ink[:, column], row) if ink[row, column] else 0
        if extent >= thickness + 3:
            columns.append(column)
        elif columns:
            break
    return columns
