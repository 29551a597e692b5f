"""Length in pixels of a drawn scale bar.

Writing is full of strokes, so that a bar is told by its whole shape, as a connected piece of ink
or a few of them that belong together:

- a stroke that ends in two upright marks: ``|---|``, U-shaped, hanging, with arrow heads, or a
  comb, with more marks at equal steps between;
- two such arms on one line, with the label between them: ``|-- 5 um --|``;
- a ruler without a base line: at least `MIN_TICKS` upright ticks at equal steps;
- a plain bar: a filled rectangle, much longer than the letters are high.

The outline of a frame, a table or a letter has other strokes above or below; a dash is short; an
underline lies close below letters along all its length. Where shapes of the same kind differ in
length, none is taken: a wrong scale is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.ingest.frame.databar import INK_CONTRAST, LOSSY_TOLERANCE
from semsfm_colmap.types import Array, Bool

MIN_PART = 0.03
"""Shortest scale bar relative to the image width."""
MIN_PLAIN_PART = 0.05
"""The same of a bar without marks."""
MAX_PART = 0.8
MAX_PLAIN_PART = 0.5
MIN_LETTERS = 2.5
"""A bar is so many times longer than letters are high; a dash once, letters that touch twice."""
TALL_LETTERS = 75.0
"""Percentile of the heights of letters that counts: one databar has several sizes of writing."""
MIN_RATIO = {"both": 1.3, "one": 3.0, "arm": 0.7}
"""Least length over height of a bar with marks that stand out on both sides of its stroke (the
widest letter of that shape, H, has 1), on one side (``LI`` that touch have 2), and of an arm."""
MIN_PLAIN_RATIO = 4.0
MAX_STROKE_PX = 12
MAX_LABEL_PART = 0.75
"""Part of the length that the label may take out of the stroke's middle."""
CROSSING = 0.6
"""A line that crosses this part of the databar's height is a separator."""
MIN_TICKS = 6
"""Of a ruler without a base line: four strokes side by side may be a Roman numeral."""
TICK_STEP = 0.5
"""Least step of a ruler relative to the height of its ticks: upright letters stand closer."""
UNDERLINED = 0.85
"""Part of a plain stroke that has letters close above it where it underlines them."""
SAME_LENGTH = 0.02
"""Relative error of a measured bar: a pixel at either end of some 100."""


@dataclass(frozen=True, kw_only=True)
class ScaleBar:
    """A drawn scale bar: its length, between the middles of its end marks where it has any."""

    length_px: float
    has_marks: bool


@dataclass(frozen=True, kw_only=True)
class _Piece:
    """A connected piece of ink: its box, rows and columns included, and its pixels."""

    top: int
    bottom: int
    left: int
    right: int
    ink: Bool

    @property
    def height(self) -> int:
        return self.bottom - self.top + 1

    @property
    def width(self) -> int:
        return self.right - self.left + 1

    @property
    def fill(self) -> float:
        return float(self.ink.mean())


@dataclass(frozen=True, kw_only=True)
class _Stroke:
    """A thin horizontal stroke with or without a mark at either end; columns of the image."""

    row: float
    left: float
    right: float
    thickness: int
    height: int
    both_sides: bool
    """Whether marks stand out above and below."""
    marks: tuple[bool, bool]

    @property
    def length(self) -> float:
        return self.right - self.left

    @property
    def is_bar(self) -> bool:
        """Whether it is marked at both ends and longer than letters of that shape."""
        ratio = MIN_RATIO["both" if self.both_sides else "one"]
        return all(self.marks) and self.length >= ratio * self.height


def find_scale_bar(bar: Array) -> ScaleBar | None:
    """The scale bar in the rows of a databar (h, W), 8-bit; None if nothing looks like one."""
    if bar.ndim != 2 or min(bar.shape) < 8:
        return None
    background = int(np.bincount(bar.ravel(), minlength=256).argmax())
    ink = np.abs(bar.astype(np.int16) - background) >= INK_CONTRAST
    ink[ink.mean(axis=1) >= 0.93] = False
    return bar_in_ink(ink)


def find_bar_over_image(levels: Array, coloured: Bool | None, *, lossy: bool) -> ScaleBar | None:
    """The scale bar that is drawn into an image (H, W), 8-bit, itself; None if there is none.

    Drawn pixels have one value, as a rule the lightest or the darkest there is, or a colour. An
    image has saturated areas too, but no rectangles with sharp ends.
    """
    if min(levels.shape) < 8:
        return None
    tolerance = LOSSY_TOLERANCE if lossy else 0
    candidates = [levels >= 255 - tolerance, levels <= tolerance]
    if coloured is not None:
        candidates.insert(0, coloured)
    found = [bar for ink in candidates if (bar := bar_in_ink(ink & ~_thick(ink))) is not None]
    lengths = [bar.length_px for bar in found]
    return _agreed(lengths, has_marks=found[0].has_marks) if found else None


def _thick(ink: Bool) -> Bool:
    """Areas of ink thicker than a bar may be, to their borders."""
    import cv2

    window = np.ones((MAX_STROKE_PX + 2,) * 2, np.uint8)
    return np.asarray(cv2.morphologyEx(ink.astype(np.uint8), cv2.MORPH_OPEN, window) > 0)


def bar_in_ink(ink: Bool) -> ScaleBar | None:
    """The scale bar among drawn pixels (h, W); None if there is none, or more than one length."""
    pieces = _pieces(ink)
    width = ink.shape[1]
    letter = _letter_height(pieces, ink.shape[0])
    crossing = max(CROSSING * ink.shape[0], 2 * letter)
    low = [piece for piece in pieces if piece.height < crossing]
    strokes = [stroke for piece in low if (stroke := _stroke(piece)) is not None]
    shortest = max(MIN_PART * width, MIN_LETTERS * letter)
    marked = [s.length for s in strokes if s.is_bar and shortest <= s.length <= MAX_PART * width]
    arms = _pairs_of_arms(strokes, ink, letter)
    lengths = [*marked, *arms[True], *_rulers(low, width)]
    if lengths:
        return _agreed(lengths, has_marks=True)
    plain = [
        float(piece.width)
        for piece in low
        if MIN_PLAIN_PART * width <= piece.width <= MAX_PLAIN_PART * width
        and _is_plain(piece, letter)
        and not _beside_separators(piece, ink)
        and not _underlines(piece, ink, letter)
    ]
    lengths = [*plain, *arms[False]]
    return _agreed(lengths, has_marks=False) if lengths else None


def _agreed(lengths: list[float], *, has_marks: bool) -> ScaleBar | None:
    longest, shortest = max(lengths), min(lengths)
    if longest - shortest > max(1.0, SAME_LENGTH * longest):
        return None
    return ScaleBar(length_px=float(np.median(lengths)), has_marks=has_marks)


def _pieces(ink: Bool) -> list[_Piece]:
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(ink.astype(np.uint8), connectivity=8)
    found = []
    for number in range(1, count):
        left, top, width, height = (int(v) for v in stats[number, :4])
        part = labels[top : top + height, left : left + width] == number
        found.append(
            _Piece(top=top, bottom=top + height - 1, left=left, right=left + width - 1, ink=part)
        )
    return found


def _letter_height(pieces: list[_Piece], rows: int) -> float:
    """How high tall letters are; 0 where there are none."""
    heights = [
        piece.height
        for piece in pieces
        if 5 <= piece.height <= CROSSING * rows and piece.width <= 2 * piece.height
        and piece.width > 0.2 * piece.height
    ]  # fmt: skip
    return float(np.percentile(heights, TALL_LETTERS)) if heights else 0.0


def _stroke(piece: _Piece) -> _Stroke | None:
    """A piece as a stroke with marks at its ends; None where it has any other shape.

    Every column holds the stroke and nothing apart from it; columns that are higher than the stroke
    are marks: at the ends, and at equal steps between them.
    """
    if piece.width < max(4.0, MIN_RATIO["arm"] * piece.height):
        return None
    runs = (np.diff(piece.ink.astype(np.int8), axis=0, prepend=0, append=0) == 1).sum(axis=0)
    # The diagonals of an arrow head part from its stroke near the ends only.
    inner = slice(piece.width // 8, piece.width - piece.width // 8)
    if (runs[inner] != 1).any():
        return None
    heights = piece.ink.sum(axis=0)
    thickness = int(np.median(heights[inner]))
    if thickness > min(MAX_STROKE_PX, piece.width / MIN_PLAIN_RATIO):
        return None
    full = piece.ink.mean(axis=1)
    rows = np.flatnonzero(full >= 0.9)
    if not 0 < len(rows) <= thickness + 1:
        return None
    extents = np.array([np.ptp(np.flatnonzero(column)) + 1 for column in piece.ink.T])
    high = extents >= thickness + 2
    middles, widths = _groups(high)
    if not middles:
        if (np.abs(heights - thickness) > 1).any():
            return None
        marks, left, right = (False, False), float(piece.left), float(piece.right)
    else:
        near = max(2.0, thickness)
        at_left = middles[0] - widths[0] / 2 <= near
        at_right = piece.width - 1 - middles[-1] - widths[-1] / 2 <= near
        between = middles[int(at_left) : len(middles) - int(at_right)]
        if max(widths) > max(thickness + 2, 0.15 * piece.width):
            return None
        if between and not (at_left and at_right and _equal_steps(middles)):
            return None
        marks = (at_left, at_right)
        left = piece.left + (middles[0] if at_left else 0.0)
        right = piece.left + (middles[-1] if at_right else piece.width - 1.0)
    return _Stroke(
        row=piece.top + float(rows.mean()),
        left=left,
        right=right,
        thickness=thickness,
        height=piece.height,
        both_sides=bool(rows[0] > 0 and rows[-1] < piece.height - 1),
        marks=(bool(marks[0]), bool(marks[1])),
    )


def _groups(high: Bool) -> tuple[list[float], list[int]]:
    """Middles and widths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], high.astype(np.int8), [0]])))
    starts, stops = edges[::2], edges[1::2]
    return [(a + b - 1) / 2 for a, b in zip(starts, stops, strict=True)], list(stops - starts)


def _equal_steps(places: list[float]) -> bool:
    """Whether places lie at equal steps, as far as whole pixels allow."""
    even = np.linspace(places[0], places[-1], len(places))
    return bool(np.abs(np.array(places) - even).max() <= 1.0)


def _pairs_of_arms(strokes: list[_Stroke], ink: Bool, letter: float) -> dict[bool, list[float]]:
    """Lengths of bars whose label interrupts them, by whether their outer ends are marked."""
    found: dict[bool, list[float]] = {True: [], False: []}
    width = ink.shape[1]
    for one in strokes:
        for other in strokes:
            arm, gap = one.right - one.left + 1, other.left - one.right
            length = other.right - one.left
            if gap <= 0 or abs(one.row - other.row) > 1 or one.marks[1] or other.marks[0]:
                continue
            marked = one.marks[0] and other.marks[1]
            if one.marks[0] != other.marks[1] or abs(one.height - other.height) > 2:
                continue
            if not max(MIN_PART * width, MIN_LETTERS * letter) <= length <= MAX_PART * width:
                continue
            if gap > MAX_LABEL_PART * length or arm < 0.01 * width:
                continue
            if abs(arm - (other.right - other.left + 1)) > max(3.0, 0.1 * length):
                continue
            if one.thickness != other.thickness or (not marked and arm < MIN_LETTERS * letter):
                continue
            row = round(one.row)
            between = ink[max(0, row - 3) : row + 4, round(one.right) + 2 : round(other.left) - 1]
            if between.any():
                found[marked].append(length if marked else length + 1.0)
    return found


def _rulers(pieces: list[_Piece], width: int) -> list[float]:
    """Lengths of rulers without a base line: ticks at equal steps, with one edge in common."""
    bars = sorted(
        (p for p in pieces if p.height >= max(3, 2 * p.width) and p.fill > 0.95),
        key=lambda p: p.left,
    )
    found = []
    for edge in ("top", "bottom"):
        for level in sorted({getattr(p, edge) for p in bars}):
            row = [p for p in bars if getattr(p, edge) == level]
            middles = [(p.left + p.right) / 2 for p in row]
            if len(row) < MIN_TICKS or not _equal_steps(middles):
                continue
            length = middles[-1] - middles[0]
            step = length / (len(row) - 1)
            if max(p.width for p in row) - min(p.width for p in row) > 2:
                continue
            if step < TICK_STEP * min(p.height for p in row) or length < MIN_PART * width:
                continue
            if length <= MAX_PART * width:
                found.append(length)
    return found


def _is_plain(piece: _Piece, letter: float) -> bool:
    """Whether a piece is a filled rectangle, long and thin."""
    return (
        piece.fill >= 0.95
        and piece.height <= MAX_STROKE_PX
        and piece.width >= max(MIN_PLAIN_RATIO * piece.height, MIN_LETTERS * letter)
    )


def _beside_separators(piece: _Piece, ink: Bool) -> bool:
    """Whether a stroke ends at lines that cross the databar: a line of a table."""
    crossing = ink.mean(axis=0) >= CROSSING
    reach = 3
    return bool(
        crossing[max(0, piece.left - reach) : piece.left].any()
        or crossing[piece.right + 1 : piece.right + 1 + reach].any()
    )


def _underlines(piece: _Piece, ink: Bool, letter: float) -> bool:
    """Whether a thin stroke lies close below letters along all its length."""
    if letter == 0 or piece.height > max(2, 0.25 * letter):
        return False
    above = ink[max(0, piece.top - round(letter)) : piece.top, piece.left : piece.right + 1]
    close = ink[max(0, piece.top - round(0.4 * letter)) : piece.top, piece.left : piece.right + 1]
    if not close.any():
        return False
    columns = np.flatnonzero(above.any(axis=0))
    return bool((np.ptp(columns) + 1) >= UNDERLINED * piece.width)
