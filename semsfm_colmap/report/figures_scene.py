"""The scene on paper: points and camera frames in one oblique parallel projection."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.report.camera_frames import (
    find_view,
    frame_outlines,
    inside_view,
    labelled_frames,
)
from semsfm_colmap.report.figure_style import GREY, FigureData, dress, new_figure
from semsfm_colmap.report.number_text import unit_text
from semsfm_colmap.report.thinning import even_subset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 20_000
FROM_ABOVE_RAD, FROM_RIGHT_RAD = np.deg2rad(30.0), np.deg2rad(25.0)
"""Where the reader stands relative to the first image."""


def scene_picture(data: FigureData) -> Figure | str:
    """Points and camera frames as in the paper's figures 16 and 17."""
    from matplotlib.collections import LineCollection

    rec, frames = data.inputs.reconstruction, data.frames
    points = rec.points[rec.track_length() >= 1]
    if len(points) == 0 or rec.num_images == 0:
        return "there are no points"
    view = find_view(points)
    # near things (z < 0) move down when seen from above, and left when seen from the right
    turn = rotation_from_vector(np.array([FROM_ABOVE_RAD, 0.0, 0.0])) @ rotation_from_vector(
        np.array([0.0, FROM_RIGHT_RAD, 0.0])
    )
    R = turn @ rec.cameras.cam_from_world[frames.image_idx[0]]
    seen = np.flatnonzero(inside_view(points, view))
    idx = seen[even_subset(len(seen), MAX_POINTS)]
    uvz = (points[idx] - view.center) @ R.T
    far_first = np.argsort(-uvz[:, 2])
    uvz = uvz[far_first]
    if rec.point_color is None:
        color = -uvz[:, 2]
    else:
        color = rec.point_color[rec.track_length() >= 1][idx][far_first] / 255.0
    outlines = (frame_outlines(rec, view)[frames.image_idx] - view.center) @ R.T
    width, height = np.ptp(np.concatenate([uvz, outlines.reshape(-1, 3)])[:, :2], axis=0)
    figure = new_figure(6.4, float(np.clip(5.7 * height / width + 0.8, 3.0, 8.0)))
    axes = figure.subplots()
    axes.scatter(uvz[:, 0], uvz[:, 1], s=1.5, c=color, linewidths=0)
    lines = LineCollection(list(outlines[..., :2]), cmap="turbo", linewidths=0.8, zorder=3)
    lines.set_array(frames.numbers.astype(float))
    axes.add_collection(lines)
    for k in labelled_frames(frames.numbers):
        axes.annotate(
            str(frames.numbers[k]), outlines[k, 2, :2], xytext=(0, 2), textcoords="offset points",
            ha="center", va="bottom", fontsize=8, color=GREY, zorder=4,
        )  # fmt: skip
    unit = unit_text(rec.world_unit)
    axes.autoscale_view()
    axes.margins(0.06)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    dress(axes, xlabel=f"[{unit}]", ylabel=f"[{unit}]", title="points and camera frames")
    return figure
