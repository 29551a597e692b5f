"""How all figures look, and the data they share; no pyplot, no global state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from semsfm_colmap.report.frames import Frames, order_frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, RED, GREY, LIGHT = "#2b6cb0", "#c05621", "#4a5568", "#bcccdc"
"""Told apart by most colour-blind readers, and in print."""
MAX_MARKED_FRAMES = 80
"""Above this many frames the markers would touch: a plain line is drawn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FigureData:
    """What a figure is drawn from."""

    inputs: ReportInputs
    metrics: dict[str, Any]
    frames: Frames
    residual: Float
    """(O, 2) px"""

    def column(self, key: str) -> Float:
        """(M,) a column of the table of images, for the registered ones; nan for None."""
        rows = [row for row in self.metrics["per_image"] if row["registered"]]
        return np.array([row.get(key) for row in rows], dtype=np.float64)

    def all_frames(self, key: str) -> Float:
        """(F,) the same for every image given."""
        return np.array([row.get(key) for row in self.metrics["per_image"]], dtype=np.float64)


def gather(inputs: ReportInputs, metrics: dict[str, Any]) -> FigureData:
    """Compute once what several figures use."""
    return FigureData(
        inputs=inputs,
        metrics=metrics,
        frames=order_frames(inputs),
        residual=inputs.reconstruction.residuals(),
    )


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that keeps its labels apart."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, *, xlabel: str = "", ylabel: str = "", title: str = "") -> None:
    """Labels, a light grid behind the data, two spines."""
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.set_title(title, fontsize=9, loc="left")
    axes.tick_params(labelsize=8, color=GREY)
    axes.grid(True, color="#e2e8f0", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)


def frame_axis(axes: Axes, num_frames: int, *, label: str = "frame") -> None:
    """Whole frame numbers on x, with half a frame of air on either side."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlim(0.5, num_frames + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, min_n_ticks=1))
    axes.set_xlabel(label, fontsize=9)


def marker_size(num_frames: int) -> float:
    """Points that do not touch one another."""
    return 0.0 if num_frames > MAX_MARKED_FRAMES else 3.5
