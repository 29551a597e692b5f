"""The list of figures, drawn to PNG; a figure without data says why instead."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from semsfm_colmap.report import (
    figures_frames,
    figures_goniometer,
    figures_overview,
    figures_residuals,
    figures_scene,
    figures_surface,
    figures_visibility,
)
from semsfm_colmap.report.figure_style import FigureData, gather
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.options import ReportOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class FigureKind:
    """One figure of the report: its file name, its caption and how to draw it."""

    name: str
    caption: str
    draw: Callable[[FigureData], Figure | str]


@dataclass(frozen=True, kw_only=True)
class DrawnFigure:
    """A figure as PNG, or the reason why there is none."""

    name: str
    caption: str
    png: bytes | None
    reason: str = ""


FIGURES = (
    FigureKind(
        name="scene",
        caption="Points and camera frames, seen obliquely. The distance of the frames is "
        "arbitrary: parallel projection does not fix it.",
        draw=figures_scene.scene_picture,
    ),
    FigureKind(
        name="surface_sigma",
        caption="Standard deviation of the surface along its normal, as seen in the middle frame: "
        "noise of the matching, relief below the windows and cameras together.",
        draw=figures_surface.surface_sigma,
    ),
    FigureKind(
        name="residual_histograms",
        caption="Residuals of the kept observations, and the Gaussian of the same mean and spread.",
        draw=figures_residuals.residual_histograms,
    ),
    FigureKind(
        name="residual_map",
        caption="Residuals against the position in the image, all frames together. A pattern "
        "speaks of distortion or drift that the camera model does not hold.",
        draw=figures_residuals.residual_map,
    ),
    FigureKind(
        name="rotation",
        caption="Rotation of the specimen about the fitted axis.",
        draw=figures_frames.rotation_per_frame,
    ),
    FigureKind(
        name="scale",
        caption="Magnification of each frame relative to the median.",
        draw=figures_frames.scale_per_frame,
    ),
    FigureKind(
        name="observations",
        caption="Points seen in each frame, and their residuals.",
        draw=figures_frames.observations_per_frame,
    ),
    FigureKind(
        name="matches",
        caption="Matches of each frame before and after verification.",
        draw=figures_frames.matches_per_frame,
    ),
    FigureKind(
        name="visibility",
        caption="Which frame sees which track: new points enter below as old ones are lost.",
        draw=figures_visibility.visibility_matrix,
    ),
    FigureKind(
        name="co_visibility",
        caption="Tracks shared by each two frames; blank where there are none.",
        draw=figures_visibility.co_visibility_matrix,
    ),
    FigureKind(
        name="track_length",
        caption="How many images see a point.",
        draw=figures_overview.track_lengths,
    ),
    FigureKind(
        name="stage_times", caption="Where the time went.", draw=figures_overview.stage_times
    ),
)


GONIOMETER_FIGURES = (
    FigureKind(
        name="goniometer_line",
        caption="Angle of the specimen against the displacement of its actuator.",
        draw=figures_goniometer.angle_against_displacement,
    ),
    FigureKind(
        name="goniometer_axis",
        caption="The rotation axis in each frame against the common one.",
        draw=figures_goniometer.axis_per_frame,
    ),
    FigureKind(
        name="goniometer_path",
        caption="The specimen's centre in the frames, from its mean place; first and last frame "
        "are numbered.",
        draw=figures_goniometer.specimen_path,
    ),
)
"""Drawn where `semsfm goniometer` has measured."""


def draw_figures(
    inputs: ReportInputs, metrics: Metrics, options: ReportOptions | None = None
) -> tuple[DrawnFigure, ...]:
    """Draw all figures in the order of `FIGURES`, and those of the goniometer where it measured."""
    dpi = (options or ReportOptions()).figure_dpi
    data = gather(inputs, metrics)
    drawn = []
    further = () if inputs.goniometer is None else GONIOMETER_FIGURES
    for kind in (*FIGURES, *further):
        result = kind.draw(data)
        if isinstance(result, str):
            figure = DrawnFigure(name=kind.name, caption=kind.caption, png=None, reason=result)
        else:
            buffer = io.BytesIO()
            result.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
            figure = DrawnFigure(name=kind.name, caption=kind.caption, png=buffer.getvalue())
        drawn.append(figure)
    return tuple(drawn)
