"""Which frame sees which track (the paper's figure 1), and how many tracks two frames share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.figure_style import (
    BLUE,
    GREY,
    FigureData,
    color_bar,
    dress,
    frame_axis,
    new_figure,
)
from semsfm_colmap.types import Float, Int

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_COLUMNS = 1000
"""More tracks than this share columns; each cell then shows the fraction of its tracks seen."""


def sorted_tracks(frame: Int, track: Int, num_tracks: int, num_frames: int) -> Int:
    """(N,) the place of each track when sorted by first frame, then last; unseen ones come last.

    `frame` and `track`, (O,), are those of the kept observations.
    """
    first = np.full(num_tracks, num_frames)
    last = np.full(num_tracks, -1)
    np.minimum.at(first, track, frame)
    np.maximum.at(last, track, frame)
    place = np.empty(num_tracks, dtype=np.int64)
    place[np.lexsort((last, first))] = np.arange(num_tracks)
    return place


def visibility_raster(
    frame: Int, track: Int, num_tracks: int, num_frames: int, max_columns: int = MAX_COLUMNS
) -> Float:
    """(M, C) fraction of each column's tracks that a frame sees; tracks sorted, unseen left out."""
    num_seen = len(np.unique(track))
    columns = max(1, min(num_seen, max_columns))
    place = sorted_tracks(frame, track, num_tracks, num_frames)
    column = place[track] * columns // max(num_seen, 1)
    seen = np.bincount(frame * columns + column, minlength=num_frames * columns)
    tracks_per_column = np.bincount(np.arange(num_seen) * columns // max(num_seen, 1))
    return seen.reshape(num_frames, columns) / np.maximum(tracks_per_column, 1)


def visibility_matrix(data: FigureData) -> Figure | str:
    """Frames by tracks, tracks sorted by the frame that sees them first."""
    from matplotlib.colors import LinearSegmentedColormap

    rec, frames = data.inputs.reconstruction, data.frames
    kept = rec.inlier
    if not kept.any():
        return "there are no kept observations"
    frame = frames.registered[frames.rank_of_image()[rec.observations.image_idx[kept]]]
    track, num = rec.observations.track_idx[kept], len(frames.names)
    num_seen = len(np.unique(track))
    raster = visibility_raster(frame, track, len(rec.points), num)
    figure = new_figure(8.0, 3.6)
    axes = figure.subplots()
    axes.imshow(
        raster, cmap=LinearSegmentedColormap.from_list("seen", [BLUE + "00", BLUE]),
        vmin=0.0, vmax=1.0, aspect="auto", interpolation="nearest",
        extent=(0, num_seen, num + 0.5, 0.5),
    )  # fmt: skip
    shared = "" if num_seen <= MAX_COLUMNS else f" (about {num_seen / MAX_COLUMNS:.0f} per column)"
    dress(axes, xlabel=f"track, sorted by first frame{shared}", title="visibility")
    frame_axis_on_y(axes, num)
    axes.grid(False)
    return figure


def frame_axis_on_y(axes: Axes, num_frames: int) -> None:
    """Whole frame numbers downward."""
    from matplotlib.ticker import MaxNLocator

    axes.set_ylim(num_frames + 0.5, 0.5)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=10, integer=True, min_n_ticks=1))
    axes.set_ylabel("frame", fontsize=9, color=GREY)


def co_visibility_matrix(data: FigureData) -> Figure | str:
    """Tracks shared by each two frames, on a logarithmic scale; those that share none are blank."""
    from matplotlib.colors import LogNorm

    shared = data.metrics.co_visibility.num_shared_tracks
    if shared.size == 0 or shared.max() < 1:
        return "there are no kept observations"
    num, at = len(data.frames.names), data.frames.registered
    full = np.full((num, num), np.nan)
    full[np.ix_(at, at)] = np.where(shared > 0, shared, np.nan)
    figure = new_figure(5.4, 4.6)
    axes = figure.subplots()
    picture = axes.imshow(
        full, cmap="viridis", norm=LogNorm(1.0, max(float(shared.max()), 2.0)),
        interpolation="nearest", extent=(0.5, num + 0.5, num + 0.5, 0.5),
    )  # fmt: skip
    color_bar(figure, picture, axes, "shared tracks")
    dress(axes, title="co-visibility")
    frame_axis(axes, num)
    frame_axis_on_y(axes, num)
    axes.grid(False)
    return figure
