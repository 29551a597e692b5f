"""Pictures of height maps: heights with a scale bar, holes, error bars, the bearing curve."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.material_ratio import MaterialRatio
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HOLE_COLOR = "#e2e8f0"
BAR_SHARE = 0.3
"""Longest scale bar in widths of the map."""
CLIP = 0.5
"""Percent of the cells at either end that do not spread the colours."""
MAX_CURVE_POINTS = 2000
DOTS_PER_INCH = 130


def height_map_picture(levelled: HeightMap, limited: HeightMap, title: str) -> bytes:
    """A PNG: levelled heights, scale-limited surface, sigma of the heights, bearing curve."""
    figure = new_figure(11.0, 8.6)
    axes = figure.subplots(2, 2)
    unit = levelled.unit
    draw_map(figure, axes[0, 0], levelled, levelled.z, f"levelled heights, {unit}", "viridis")
    draw_map(figure, axes[0, 1], limited, limited.z, f"scale-limited surface, {unit}", "viridis")
    if levelled.sigma is not None:
        label = f"sigma of the heights, {unit}"
        draw_map(figure, axes[1, 0], levelled, levelled.sigma, label, "magma")
    else:
        axes[1, 0].set_axis_off()
    draw_bearing_curve(axes[1, 1], limited)
    figure.suptitle(title, fontsize=10)
    return png(figure)


def difference_picture(
    difference: HeightMap, significant: HeightMap, sigma: Float, title: str
) -> bytes:
    """A PNG: differences of two surfaces, those beyond their 95 % bounds, and their sigma."""
    figure = new_figure(13.0, 4.6)
    axes = figure.subplots(1, 3)
    unit = difference.unit
    largest = float(np.nanpercentile(np.abs(difference.z), 100.0 - CLIP))
    for axis, shown, label in (
        (axes[0], difference, f"after minus before, {unit}"),
        (axes[1], significant, f"beyond the 95 % bounds, {unit}"),
    ):
        draw_map(figure, axis, shown, shown.z, label, "RdBu_r", (-largest, largest))
    draw_map(figure, axes[2], difference, sigma, f"sigma of the difference, {unit}", "magma")
    figure.suptitle(title, fontsize=10)
    return png(figure)


def draw_map(
    figure: Figure,
    axes: Axes,
    height_map: HeightMap,
    values: Float,
    title: str,
    colors: str,
    limits: tuple[float, float] | None = None,
) -> None:
    """Values of the cells in colours, holes grey, rows upward, with a scale bar."""
    import matplotlib as mpl

    low, high = limits or tuple(np.nanpercentile(values, [CLIP, 100.0 - CLIP]))
    shades = mpl.colormaps[colors].with_extremes(bad=HOLE_COLOR)
    width, height = height_map.size
    image = axes.imshow(
        values,
        origin="lower",
        extent=(0.0, width, 0.0, height),
        cmap=shades,
        vmin=low,
        vmax=max(high, low + 1e-12),
        interpolation="nearest",
    )
    figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
    axes.set_title(title, fontsize=9, loc="left")
    axes.set_xticks([])
    axes.set_yticks([])
    length = round_length(BAR_SHARE * width)
    x, y = 0.05 * width, 0.06 * height
    axes.plot([x, x + length], [y, y], color="black", linewidth=5.0, solid_capstyle="butt")
    axes.plot([x, x + length], [y, y], color="white", linewidth=3.0, solid_capstyle="butt")
    axes.annotate(
        f"{length:g} {height_map.unit}",
        (x + length / 2.0, y + 0.02 * height),
        ha="center",
        va="bottom",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
    )


def draw_bearing_curve(axes: Axes, height_map: HeightMap) -> None:
    """The material ratio curve with the equivalent straight line of its core."""
    curve = MaterialRatio.of(height_map.z)
    some = np.linspace(0, len(curve.heights) - 1, min(len(curve.heights), MAX_CURVE_POINTS))
    pick = some.astype(int)
    core = curve.core()
    axes.plot(100.0 * curve.ratio[pick], curve.heights[pick], color="#2b6cb0")
    top = curve.height(core.mr1) if 0.0 < core.mr1 < 1.0 else float(curve.heights[0])
    axes.plot([0.0, 100.0], [top, top - core.k], color="#c05621", linewidth=1.0)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("material ratio, %", fontsize=9)
    axes.set_ylabel(f"height, {height_map.unit}", fontsize=9)
    axes.set_title("bearing curve of the scale-limited surface", fontsize=9, loc="left")
    axes.grid(True, color="#e2e8f0", linewidth=0.6)
    axes.tick_params(labelsize=8)


def round_length(most: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(f * power for f in (1.0, 2.0, 5.0) if f * power <= most * (1.0 + 1e-9)))


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that keeps its labels apart; no pyplot, no global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as a PNG file."""
    content = BytesIO()
    figure.savefig(content, format="png", dpi=DOTS_PER_INCH)
    return content.getvalue()
