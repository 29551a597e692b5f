"""How all figures look, and the data they share; no pyplot, no global state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.frames import Frames, order_frames
from semsfm_colmap.report.image_statistics import PoseMetrics
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.match_statistics import FrameMatches
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

BLUE, RED, GREY, LIGHT = "#3d7fc4", "#d0642b", "#76808f", "#aebdcd"
"""Told apart by most colour-blind readers, and in print. Mid-tones on a transparent ground: one
drawing serves the light page, the dark one and paper."""
GRID = "#8896a840"
MAX_MARKED_FRAMES = 80
"""Above this many frames the markers would touch: a plain line is drawn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FigureData:
    """What a figure is drawn from."""

    inputs: ReportInputs
    metrics: Metrics
    frames: Frames
    residual: Float
    """(O, 2) px"""

    def of_poses(self, value: Callable[[PoseMetrics], float | None]) -> Float:
        """(M,) a value of each registered image; nan for None."""
        poses = [image.pose for image in self.metrics.per_image if image.pose is not None]
        return np.array([value(pose) for pose in poses], dtype=np.float64)

    def of_matches(self, value: Callable[[FrameMatches], int | None]) -> Float:
        """(F,) a value of every image given; nan for None."""
        return np.array(
            [value(image.matches) for image in self.metrics.per_image], dtype=np.float64
        )


def gather(inputs: ReportInputs, metrics: Metrics) -> FigureData:
    """Compute once what several figures use."""
    return FigureData(
        inputs=inputs,
        metrics=metrics,
        frames=order_frames(inputs),
        residual=inputs.reconstruction.residuals(),
    )


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that keeps its labels apart, transparent, so that the page shows through."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="none")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, *, xlabel: str = "", ylabel: str = "", title: str = "") -> None:
    """Labels, a light grid behind the data, two spines."""
    axes.set_facecolor("none")
    axes.set_xlabel(xlabel, fontsize=9, color=GREY)
    axes.set_ylabel(ylabel, fontsize=9, color=GREY)
    axes.set_title(title, fontsize=9, loc="left", color=GREY)
    axes.tick_params(labelsize=8, colors=GREY)
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)


def frame_axis(axes: Axes, num_frames: int, *, label: str = "frame") -> None:
    """Whole frame numbers on x, with half a frame of air on either side."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlim(0.5, num_frames + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, min_n_ticks=1))
    axes.set_xlabel(label, fontsize=9, color=GREY)


def color_bar(figure: Figure, mappable: ScalarMappable, axes: Axes, label: str) -> None:
    """A colour bar in the colours of the other lettering."""
    bar = figure.colorbar(mappable, ax=axes, shrink=0.8)
    bar.set_label(label, fontsize=9, color=GREY)
    bar.ax.tick_params(labelsize=8, colors=GREY)
    bar.outline.set_edgecolor(GREY)


def key(axes: Axes, num_columns: int = 3) -> None:
    """A legend above the axes, where no data can be."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=num_columns, fontsize=8,
        frameon=False, borderaxespad=0.1, handlelength=1.2, labelcolor=GREY,
    )  # fmt: skip


def marker_size(num_frames: int) -> float:
    """Points that do not touch one another."""
    return 0.0 if num_frames > MAX_MARKED_FRAMES else 3.5
