"""Track lengths and stage times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.figure_style import BLUE, GREY, FigureData, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOG_RATIO = 50
"""Counts that span more than this are drawn on a logarithmic axis."""


def track_lengths(data: FigureData) -> Figure | str:
    """How many points are seen in how many images."""
    from matplotlib.ticker import MaxNLocator

    counts = np.array(data.metrics.structure.track_length_counts)
    length = np.flatnonzero(counts)
    length = length[length > 0]
    if len(length) == 0:
        return "there are no kept observations"
    figure = new_figure(5.4, 3.2)
    axes = figure.subplots()
    axes.bar(length, counts[length], width=0.85, color=BLUE, linewidth=0)
    if counts[length].max() > LOG_RATIO * counts[length].min():
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.7)
    axes.set_xlim(0.5, length.max() + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, min_n_ticks=1))
    dress(axes, xlabel="images that see the point", ylabel="points", title="track length")
    return figure


def stage_times(data: FigureData) -> Figure | str:
    """Seconds of each stage, in the order they ran."""
    stages = data.metrics.stages
    if not stages:
        return "no stage times were given"
    seconds = np.array([stage.seconds for stage in stages], dtype=np.float64)
    figure = new_figure(5.4, 1.0 + 0.3 * len(stages))
    axes = figure.subplots()
    y = np.arange(len(stages))
    axes.barh(y, seconds, height=0.7, color=BLUE)
    axes.set_yticks(y, [stage.name.replace("$", r"\$") for stage in stages])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.25 * max(float(seconds.max()), 1e-3))
    for row, value in enumerate(seconds):
        axes.annotate(
            f"{value:.1f} s", (value, row), xytext=(4, 0), textcoords="offset points",
            va="center", fontsize=8, color=GREY,
        )  # fmt: skip
    dress(axes, xlabel="time [s]", title=f"{seconds.sum():.0f} s in all")
    axes.grid(False, axis="y")
    return figure
