"""The places and regions of measurements, drawn into the images that they were picked in."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from semsfm_colmap.report.figure_style import BLUE, RED, new_figure
from semsfm_colmap.types import Array

WIDTH_IN = 7.5
DPI = 150


def picked_images(ones: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the images that something was picked in, in the order of the measurements."""
    return list(dict.fromkeys(mark["image"] for one in ones for mark in one["where"]))


def draw_marks(
    pixels: Array, origin: tuple[int, int], name: str, ones: Sequence[Mapping[str, Any]]
) -> bytes:
    """A PNG of an image with all that was picked in it, in px of the original.

    Parameters
    ----------
    pixels : (H, W) the prepared image
    origin : where it begins in the original, px
    name : of the image
    ones : entries of measurements.json

    """
    height, width = pixels.shape
    x0, y0 = origin
    figure = new_figure(WIDTH_IN, WIDTH_IN * height / width + 0.4)
    axes = figure.subplots()
    box = (x0, x0 + width, y0 + height, y0)
    axes.imshow(pixels, cmap="gray", extent=box, interpolation="nearest")
    for corners, names in _marks(name, ones).items():
        x, y = zip(*corners, strict=True)
        if len(x) > 1:
            axes.fill(x, y, fill=False, edgecolor=BLUE, linewidth=1.2)
        else:
            axes.plot(x, y, "+", color=RED, markersize=8, markeredgewidth=1.4)
        axes.annotate(
            ", ".join(names),
            (min(x), min(y)),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=8,
            color="white",
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "#1a202c", "alpha": 0.6, "lw": 0},
        )
    axes.set_xlim(box[:2])
    axes.set_ylim(box[2:])
    axes.tick_params(labelsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def _marks(
    image: str, ones: Sequence[Mapping[str, Any]]
) -> dict[tuple[tuple[float, float], ...], list[str]]:
    """What was picked in an image, each once, with the names of the measurements that use it."""
    found: dict[tuple[tuple[float, float], ...], list[str]] = {}
    for one in ones:
        for mark in one["where"]:
            if mark["image"] == image:
                names = found.setdefault(tuple((x, y) for x, y in mark["xy"]), [])
                if one["name"] not in names:
                    names.append(one["name"])
    return found
