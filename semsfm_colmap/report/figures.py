"""The list of figures, drawn to PNG; a figure without data says why instead."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report import (
    figures_frames,
    figures_goniometer,
    figures_images,
    figures_overview,
    figures_progress,
    figures_residuals,
    figures_scene,
    figures_structure,
    figures_surface,
    figures_visibility,
)
from semsfm_colmap.report.figure_style import FigureData, gather
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.types import Int

PADDING_PX = 6

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class FigureKind:
    """One figure of the report: its file name, its caption and how to draw it."""

    name: str
    caption: str
    draw: Callable[[FigureData], Figure | str]
    picture: bool = False
    """Made of pixels rather than lines: it travels in the page as a lossy picture."""


@dataclass(frozen=True, kw_only=True)
class DrawnFigure:
    """A figure as PNG, or the reason why there is none."""

    name: str
    caption: str
    png: bytes | None
    reason: str = ""
    picture: bool = False


FIGURES = (
    FigureKind(
        name="scene",
        caption="Points and camera frames, seen obliquely. The distance of the frames is "
        "arbitrary: parallel projection does not fix it.",
        draw=figures_scene.scene_picture,
        picture=True,
    ),
    FigureKind(
        name="regions",
        caption="Regions detected in the middle image, the paper's figure 3: ellipses of twice the "
        "keypoints' scale, a line in their orientation. They should sit on structure of the "
        "specimen, in all parts of it.",
        draw=figures_images.detected_regions,
        picture=True,
    ),
    FigureKind(
        name="match_filters",
        caption="Matches of two neighbours as they were found and after each filter, the paper's "
        "figure 4; what a filter dropped is red. What is left should be nearly parallel.",
        draw=figures_images.filtered_matches,
        picture=True,
    ),
    FigureKind(
        name="trajectories",
        caption="Trajectories of tracks over the middle image, the paper's figure 5: from earlier "
        "frames blue, to later ones red. Under rotation about one axis they are smooth and "
        "alike; one that stands out is a mismatch.",
        draw=figures_images.trajectories,
        picture=True,
    ),
    FigureKind(
        name="structure_progress",
        caption="The structure as the paper's figure 6 has it, seen mostly from above: points of "
        "all tracks, those that filtering leaves (both with the final cameras), and the model. "
        "Strays should be gone from the second on.",
        draw=figures_progress.structure_progress,
        picture=True,
    ),
    FigureKind(
        name="camera_trajectory",
        caption="The cameras around the point cloud, the paper's figures 16 and 17. Frames should "
        "follow one another on an even curve; their distance is arbitrary.",
        draw=figures_structure.camera_trajectory,
        picture=True,
    ),
    FigureKind(
        name="textured_structure",
        caption="The estimated structure and the same with texture, the paper's figure 18. Texture "
        "that runs across relief speaks of a wrong surface.",
        draw=figures_structure.textured_structure,
        picture=True,
    ),
    FigureKind(
        name="meshed_surface",
        caption="The meshed surface with its axes, the paper's figure 19; coarser than mesh.ply.",
        draw=figures_structure.meshed_surface,
        picture=True,
    ),
    FigureKind(
        name="surface_sigma",
        caption="Standard deviation of the surface along its normal, as seen in the middle frame: "
        "noise of the matching, relief below the windows and cameras together.",
        draw=figures_surface.surface_sigma,
        picture=True,
    ),
    FigureKind(
        name="residual_histograms",
        caption="Residuals of the kept observations, and the Gaussian of the same mean and spread; "
        "the paper's figure 15. Thick tails are outliers that were left.",
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
        caption="Matches of each frame before and after verification, the paper's figure 14. No "
        "frame should fall far below its neighbours.",
        draw=figures_frames.matches_per_frame,
    ),
    FigureKind(
        name="visibility",
        caption="Which frame sees which track, the paper's figure 1: new points enter below as old "
        "ones are lost. A gap breaks the chain.",
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
    inputs: ReportInputs,
    metrics: Metrics,
    options: ReportOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[DrawnFigure, ...]:
    """Draw all figures in the order of `FIGURES`, and those of the goniometer where it measured."""
    dpi = (options or ReportOptions()).figure_dpi
    data = gather(inputs, metrics)
    drawn = []
    further = () if inputs.goniometer is None else GONIOMETER_FIGURES
    kinds = (*FIGURES, *further)
    for done, kind in enumerate(kinds):
        if progress is not None:
            progress(done, len(kinds))
        result = kind.draw(data)
        png, reason = (None, result) if isinstance(result, str) else (_png(result, dpi), "")
        drawn.append(
            DrawnFigure(
                name=kind.name, caption=kind.caption, png=png, reason=reason, picture=kind.picture
            )
        )
    return tuple(drawn)


def _png(figure: Figure, dpi: int) -> bytes:
    """A figure without the empty margins that a box of three axes leaves."""
    from PIL import Image

    figure.set_dpi(dpi)
    figure.canvas.draw()
    rgba = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    rows, columns = (np.flatnonzero(rgba[..., 3].any(axis=k)) for k in (1, 0))
    if len(rows):
        rgba = rgba[_padded(rows, rgba.shape[0]), _padded(columns, rgba.shape[1])]
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgba)).save(buffer, "PNG", compress_level=6)
    return buffer.getvalue()


def _padded(used: Int, size: int) -> slice:
    """From the first used row or column to the last, with some air."""
    return slice(max(0, int(used[0]) - PADDING_PX), min(size, int(used[-1]) + 1 + PADDING_PX))
