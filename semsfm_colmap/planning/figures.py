"""Plots of a plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.planning.next_angles import MappedSeries, NextAngles, criterion_px
from semsfm_colmap.planning.options import Criterion
from semsfm_colmap.planning.series import PlannedSeries
from semsfm_colmap.report.figure_style import BLUE, GREY, RED, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def series_figure(
    curves: Mapping[float, Sequence[PlannedSeries]],
    chosen: Sequence[PlannedSeries],
    wanted_px: float | None,
) -> Figure:
    """Median depth sigma against the number of images, a curve a total angle.

    Parameters
    ----------
    curves : by total angle, deg
    chosen : series to be marked
    wanted_px : a line at that sigma

    """
    from matplotlib import colormaps
    from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

    figure = new_figure(7.0, 4.6)
    axes = figure.add_subplot()
    shade = colormaps["viridis"]
    shown = [total for total, series in curves.items() if series]
    for k, total in enumerate(shown):
        frames = [series.size.num_frames for series in curves[total]]
        sigma = [series.prediction.median_px for series in curves[total]]
        color = shade(0.9 * k / max(len(shown) - 1, 1))
        axes.plot(frames, sigma, "-o", ms=3, lw=1.4, color=color, label=f"{total:g} deg")
    if wanted_px is not None:
        axes.axhline(wanted_px, color=RED, lw=1.0, ls="--")
        axes.annotate(
            f"wanted: {wanted_px:g} px", (1.0, wanted_px), xycoords=("axes fraction", "data"),
            ha="right", va="bottom", fontsize=8, color=RED,
        )  # fmt: skip
    frames = [series.size.num_frames for series in chosen]
    sigma = [series.prediction.median_px for series in chosen]
    axes.plot(frames, sigma, "o", ms=9, mfc="none", mec=RED, mew=1.5, label="this plan")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(NullFormatter())
    dress(axes, xlabel="images", ylabel="depth sigma by noise, median, px",
          title="How many images over which total angle")  # fmt: skip
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def next_figure(found: NextAngles, series: MappedSeries, criterion: Criterion) -> Figure:
    """What one more image at each angle would give, and what those chosen give one by one."""
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    there = np.rad2deg(series.axis.angle_rad)
    before = criterion_px(found.before, criterion)
    left.plot(found.tried_deg, found.tried_px, "-o", color=BLUE, ms=3, lw=1.2)
    left.axhline(before, color=GREY, lw=1.0, ls="--", label="as it is")
    left.plot(there, np.full(len(there), before), "|", color=GREY, ms=9, label="images there are")
    for number, image in enumerate(found.added, start=1):
        left.axvline(image.angle_deg, color=RED, lw=1.0)
        left.annotate(
            str(number), (image.angle_deg, 0.02), xycoords=("data", "axes fraction"),
            fontsize=9, color=RED, xytext=(3, 0), textcoords="offset points",
        )  # fmt: skip
    label = f"{'mean' if criterion == 'mean' else 'worst 5 %'} depth sigma by noise, px"
    dress(left, xlabel="angle about the axis, deg", ylabel=label, title="With one more image")
    left.legend(fontsize=8, frameon=False)
    values = [before, *(criterion_px(image.prediction, criterion) for image in found.added)]
    right.plot(range(len(values)), values, "-o", color=RED, ms=4, lw=1.2)
    right.set_xticks(range(len(values)))
    dress(right, xlabel="images added", ylabel=label, title="Added one after the other")
    return figure
