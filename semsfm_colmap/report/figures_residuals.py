"""Residuals: their histograms per axis (the paper's figure 15) and where in the image they lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.figure_style import (
    BLUE,
    GREY,
    RED,
    FigureData,
    color_bar,
    dress,
    new_figure,
)
from semsfm_colmap.report.number_text import fixed
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MIN_BINS, MAX_BINS = 21, 81
HALF_RANGE_SIGMAS = 4.0
MIN_CELLS, MAX_CELLS = 4, 16
"""Cells of the residual map along the width; the height gets as many as keep them square."""
MEAN_PER_CELL = 60
"""Observations a cell should hold on average, which sets how many cells there are."""
MIN_PER_CELL = 20
"""Cells with fewer observations are left blank: their mean is noise (0.2 sigma here)."""


def _histogram(axes: Axes, r: Float, mean: float, sigma: float, half: float) -> None:
    num_bins = int(np.clip(np.sqrt(len(r)), MIN_BINS, MAX_BINS)) | 1
    counts, edges = np.histogram(r, bins=num_bins, range=(-half, half))
    axes.stairs(counts, edges, fill=True, color=BLUE, alpha=0.55)
    if sigma > 0.0:
        x = np.linspace(-half, half, 400)
        density = np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
        axes.plot(x, len(r) * (edges[1] - edges[0]) * density, color=RED, linewidth=1.4)
    axes.axvline(0.0, color=GREY, linewidth=0.7, linestyle=":")
    axes.set_xlim(-half, half)
    axes.set_ylim(bottom=0.0)


def residual_histograms(data: FigureData) -> Figure | str:
    """Histograms of the residuals in x and y with the Gaussian of the same mean and spread."""
    kept = data.residual[data.inputs.reconstruction.inlier]
    stats = data.metrics.residuals
    if stats is None:
        return "there are no kept observations"
    sigma = max(stats.x.sigma_px, stats.y.sigma_px)
    half = max(HALF_RANGE_SIGMAS * sigma, float(np.percentile(np.abs(kept), 99)), 1e-6)
    figure = new_figure(8.0, 3.2)
    panels = figure.subplots(1, 2, sharey=True)
    for axis, (axes, r) in enumerate(zip(panels, (stats.x, stats.y), strict=True)):
        letter = "xy"[axis]
        title = f"{letter}:  μ = {fixed(r.mean_px, 2)} px,  σ = {r.sigma_px:.2f} px"
        if r.mean_nm is not None and r.sigma_nm is not None:
            title += f"\n     μ = {fixed(r.mean_nm, 1)} nm,  σ = {r.sigma_nm:.1f} nm"
        _histogram(axes, kept[:, axis], r.mean_px, r.sigma_px, half)
        dress(axes, xlabel=f"residual in {letter} [px]", title=title)
    panels[0].set_ylabel("observations per bin", fontsize=9, color=GREY)
    return figure


def residual_map(data: FigureData) -> Figure | str:
    """RMS and mean residual over the image, all frames together: what the model does not hold."""
    rec = data.inputs.reconstruction
    xy, r = rec.observations.xy[rec.inlier], data.residual[rec.inlier]
    if len(xy) == 0:
        return "there are no kept observations"
    width, height = np.max(rec.image_size_px, axis=0).astype(float)
    nx = int(np.clip(np.sqrt(len(xy) / MEAN_PER_CELL * width / height), MIN_CELLS, MAX_CELLS))
    ny = max(1, round(nx * height / width))
    column = np.clip((xy[:, 0] / width * nx).astype(np.int64), 0, nx - 1)
    row = np.clip((xy[:, 1] / height * ny).astype(np.int64), 0, ny - 1)
    cell = row * nx + column
    num = np.bincount(cell, minlength=nx * ny)
    full = np.where(num >= MIN_PER_CELL, num, np.nan)
    mean = [np.bincount(cell, weights=r[:, k], minlength=nx * ny) / full for k in (0, 1)]
    rms = np.sqrt(np.bincount(cell, weights=(r**2).sum(1), minlength=nx * ny) / (2.0 * full))
    if not np.isfinite(rms).any():
        return f"no part of the image holds {MIN_PER_CELL} kept observations"

    figure = new_figure(8.6, 0.9 + 3.7 * min(max(height / width, 0.4), 1.4))
    left, right = figure.subplots(1, 2, sharey=True, gridspec_kw={"wspace": 0.08})
    picture = left.imshow(
        rms.reshape(ny, nx), extent=(0, width, height, 0), cmap="viridis", vmin=0.0
    )
    color_bar(figure, picture, left, "RMS per coordinate [px]")
    x, y = np.meshgrid((np.arange(nx) + 0.5) * width / nx, (np.arange(ny) + 0.5) * height / ny)
    longest = float(np.nanmax(np.hypot(*mean)))
    key = float(f"{max(longest, 1e-9):.1g}")
    arrows = right.quiver(
        x, y, mean[0].reshape(ny, nx), mean[1].reshape(ny, nx),
        color=BLUE, angles="xy", scale_units="xy", scale=key / (width / nx), width=0.005,
    )  # fmt: skip
    right.quiverkey(
        arrows, 0.86, 1.05, key, f"{key:g} px", labelpos="E", labelcolor=GREY,
        fontproperties={"size": 8},
    )  # fmt: skip
    right.set_aspect("equal")
    right.set_xlim(0, width)
    right.set_ylim(height, 0)
    for axes, title in ((left, "RMS of the residuals"), (right, "mean residual")):
        dress(axes, xlabel="x [px]", title=title)
        axes.grid(False)
    left.set_ylabel("y [px]", fontsize=9, color=GREY)
    return figure
