"""Maps of numbers in colours, with what a colour bar needs; unknown places are transparent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float

LOW_PERCENTILE, HIGH_PERCENTILE = 1.0, 99.0
"""Colours span these percentiles, so that a few strays do not take them all."""
NUM_STOPS = 9


@dataclass(frozen=True, kw_only=True)
class ColorRange:
    """Which numbers the two ends of the colours stand for."""

    low: float
    high: float


def color_range(values: Array) -> ColorRange | None:
    """The range of the known values; None where there are none."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return None
    low, high = (float(v) for v in np.percentile(known, [LOW_PERCENTILE, HIGH_PERCENTILE]))
    return ColorRange(low=low, high=high)


def color_table(name: str) -> Array:
    """(256, 3) uint8 of one of matplotlib's colour maps."""
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps[name](np.arange(256))[:, :3]).astype(np.uint8)


def colored(values: Array, span: ColorRange, table: Array) -> Array:
    """(H, W) -> (H, W, 4) uint8, transparent where nothing is known."""
    known = np.isfinite(values)
    width = max(span.high - span.low, 1e-300)
    # an error bar may be as large as its type holds: bounded before it is scaled
    within = np.clip(np.nan_to_num(values), span.low, span.high)
    at = np.clip((within - span.low) / width, 0.0, 1.0)
    rgba = np.empty((*values.shape, 4), dtype=np.uint8)
    rgba[..., :3] = table[np.rint(255.0 * at).astype(np.int64)]
    rgba[..., 3] = 255 * known
    return rgba


def shrunk_map(values: Float, width_px: int) -> Float:
    """A map of a lesser width by taking every so manieth value: no mean across an edge."""
    height, width = values.shape
    if width <= width_px:
        return values
    rows = max(1, round(height * width_px / width))
    row = ((np.arange(rows) + 0.5) * height / rows).astype(np.int64)
    column = ((np.arange(width_px) + 0.5) * width / width_px).astype(np.int64)
    return np.asarray(values[np.ix_(row, column)])


def css_stops(table: Array) -> str:
    """The colours as the arguments of a CSS gradient."""
    picked = table[np.linspace(0, 255, NUM_STOPS).astype(int)]
    return ", ".join("#{:02x}{:02x}{:02x}".format(*rgb) for rgb in picked.tolist())
