"""Databars as microscopes draw them: writing in several fonts, boxes, logos, and scale bars."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_PLAIN,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
)
WORDS = (
    "EHT = 5.00 kV", "WD = 8.1 mm", "Signal A = SE2", "Mag = 2.54 K X", "SE(U)", "HFW", "ETD",
    "LFD", "det", "mode", "x3.17k", "20.0um", "S-4700", "10.0kV", "Date: 2019-03-07", "T: 15 deg",
    "ILLINI - LAB", "Dwell 1 us", "III", "HHH", "UUU", "_T_", "EFTEM", "12/11/2020", "IIIII-L",
    "TILT", "H - H", "50 - 60 %", "==", "--", "EEE", "LLL", "FIELD: 111 um", "|x|", "Nr. 1111111",
)  # fmt: skip
KINDS = ("ticked", "u_up", "u_down", "labelled", "ruler", "comb", "plain", "thick_ends")


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A databar (h, W) and the length of the bar in it; None where it has none."""

    pixels: np.ndarray
    length_px: float | None


def draw_databar(rng: np.random.Generator, kind: str | None) -> Drawn:
    """A databar of random size, polarity, fonts and boxes, with a bar of a kind or without one."""
    width = int(rng.choice([320, 512, 640, 1024]))
    height = max(28, int(width * rng.uniform(0.07, 0.12)))
    bar = np.zeros((height, width), np.uint8)
    room = width if kind is None else int(0.5 * width)
    _write(rng, bar[:, :room])
    length = None
    if kind is not None:
        length = _draw_bar(rng, bar[:, room + 6 : width - 6], kind)
        if rng.random() < 0.5:
            bar[:, room] = 255
    if rng.random() < 0.5:
        bar[0] = 255
    if rng.random() < 0.3:
        bar[:, 0] = bar[:, -1] = bar[-1] = bar[0] = 255
    if rng.random() < 0.3:
        bar = np.minimum(bar, 235)
    return Drawn(pixels=255 - bar if rng.random() < 0.5 else bar, length_px=length)


def _write(rng: np.random.Generator, bar: np.ndarray) -> None:
    """Lines of words, at times boxed, ruled or with a logo."""
    height, width = bar.shape
    lines = int(rng.integers(1, 3)) if height < 60 else int(rng.integers(1, 4))
    size = height / lines
    for line in range(lines):
        x = int(rng.integers(3, 12))
        while x < width - 20:
            word = str(rng.choice(WORDS))
            drawn = _word(rng, word, size)
            y = int(line * size + (size - drawn.shape[0]) / 2)
            if x + drawn.shape[1] >= width - 2 or y < 0 or y + drawn.shape[0] > height:
                break
            part = bar[y : y + drawn.shape[0], x : x + drawn.shape[1]]
            np.maximum(part, drawn, out=part)
            x += drawn.shape[1] + int(rng.integers(6, 16))
            if rng.random() < 0.15 and x < width - 8:
                bar[:, x] = 255
                x += 6


def _word(rng: np.random.Generator, word: str, size: float) -> np.ndarray:
    """A word in a font of either library, cut to its ink."""
    if rng.random() < 0.5:
        font = ImageFont.load_default(max(8.0, size * rng.uniform(0.4, 0.7)))
        image = Image.new("L", (int(size * len(word)) + 20, int(2 * size) + 20))
        ImageDraw.Draw(image).text((5, 5), word, fill=255, font=font)
        drawn = np.asarray(image)
    else:
        drawn = np.zeros((int(2 * size) + 20, int(size * len(word)) + 40), np.uint8)
        scale = size * rng.uniform(0.4, 0.7) / 22
        thickness = 2 if scale > 0.8 else 1
        smooth = cv2.LINE_AA if rng.random() < 0.5 else cv2.LINE_8
        cv2.putText(
            drawn, word, (5, int(1.3 * size) + 5), int(rng.choice(FONTS)), scale, 255, thickness,
            smooth,
        )  # fmt: skip
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    return drawn[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _draw_bar(rng: np.random.Generator, room: np.ndarray, kind: str) -> float:
    """Draw a bar of a kind with its label; its length between the middles of its marks."""
    height, width = room.shape
    length = int(rng.uniform(0.45, 0.9) * width)
    first = int(rng.integers(2, width - length - 2))
    row = int(0.72 * height)
    tick = max(3, int(height * rng.uniform(0.1, 0.2)))
    thick = int(rng.integers(1, 4))
    label = _word(rng, str(rng.choice(["5 um", "20.0um", "100 nm", "1 mm"])), 0.5 * height)
    label = label[: max(4, row - tick - 4), : width - 4]
    if kind in ("ruler", "comb"):
        steps = int(rng.choice([10, 5] if kind == "comb" else [10]))
        places = first + np.rint(np.linspace(0, length, steps + 1)).astype(int)
        for x in places:
            room[row - tick : row + 1, x : x + min(thick, 2)] = 255
        if kind == "comb":
            room[row : row + thick, first : places[-1] + min(thick, 2)] = 255
        distance = float(places[-1] - places[0])
        _put(room, label, 2, (width - label.shape[1]) // 2, row - tick - 2)
        return distance
    last = first + length
    if kind == "labelled":
        middle = min(label.shape[1] + 8, int(0.6 * length))
        label = label[:, : middle - 6]
        left, right = first + (length - middle) // 2, first + (length + middle) // 2
        room[row : row + thick, first:left] = room[row : row + thick, right + 1 : last + 1] = 255
        _put(room, label, row - label.shape[0] // 2, first + (length - label.shape[1]) // 2, height)
    else:
        room[row : row + thick, first : last + 1] = 255
        _put(room, label, 2, first + (length - label.shape[1]) // 2, row - tick - 2)
    if kind == "plain":
        return float(length + 1)
    above = tick + 2 if kind != "u_down" else 0
    below = tick + 2 if kind != "u_up" else 0
    wide = thick if kind == "thick_ends" else 1
    top, bottom = max(0, row - above), min(height, row + thick + below)
    room[top:bottom, first : first + wide] = 255
    room[top:bottom, last - wide + 1 : last + 1] = 255
    return float(length - wide + 1)


def _put(room: np.ndarray, drawn: np.ndarray, row: int, column: int, below: int) -> None:
    """Draw a label where it fits above a row."""
    row, column = max(0, row), max(0, column)
    drawn = drawn[: max(0, min(below, room.shape[0]) - row), : max(0, room.shape[1] - column)]
    part = room[row : row + drawn.shape[0], column : column + drawn.shape[1]]
    np.maximum(part, drawn, out=part)
