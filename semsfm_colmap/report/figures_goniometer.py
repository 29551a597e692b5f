"""The goniometer: angle against displacement, the axis in each image, the specimen's path."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.records import GoniometerImage, GoniometerRecord
from semsfm_colmap.report.figure_style import (
    BLUE,
    GREY,
    RED,
    FigureData,
    dress,
    key,
    marker_size,
    new_figure,
)
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOT_MEASURED = "semsfm goniometer was not run"
EQUAL_MARGIN = 1.15


def _column(record: GoniometerRecord, value: Callable[[GoniometerImage], float | None]) -> Float:
    """(M,) a value of each image; nan for None."""
    return np.array([value(image) for image in record.images.values()], dtype=np.float64)


def angle_against_displacement(data: FigureData) -> Figure | str:
    """The angles over the read-outs, and below what the line leaves, by direction of the run."""
    record = data.inputs.goniometer
    if record is None:
        return NOT_MEASURED
    factor = record.conversion_deg_per_um
    if factor is None or record.displacement is None:
        return "no displacements are known"
    x = _column(record, lambda image: image.displacement_um)
    angle = _column(record, lambda image: image.angle_deg)
    residual = _column(record, lambda image: image.residual_deg)
    sigma = _column(record, lambda image: image.sigma_deg)
    outlier = np.isin(list(record.images), record.displacement.outliers)
    figure = new_figure(8.0, 5.0)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    ends = np.array([np.nanmin(x), np.nanmax(x)])
    middle = float(np.nanmedian(angle - factor.value * x))
    top.plot(ends, factor.value * ends + middle, color=GREY, linewidth=0.9, linestyle="--")
    size = max(marker_size(len(x)), 2.0)
    top.plot(x[~outlier], angle[~outlier], "o", color=BLUE, markersize=size)
    title = f"{factor.value:.2f} ± {factor.sigma:.2f} ° per µm"
    dress(top, ylabel="angle [°]", title=title)
    bottom.axhline(0.0, color=GREY, linewidth=0.8, linestyle="--")
    kept = np.isfinite(residual) & ~outlier
    bottom.errorbar(
        x[kept], residual[kept], yerr=np.nan_to_num(sigma[kept]), fmt="o", color=BLUE,
        ecolor=RED, markersize=size, elinewidth=0.9,
    )  # fmt: skip
    if outlier.any():
        top.plot(x[outlier], angle[outlier], "x", color=RED, markersize=7.0)
        reach = 1.3 * max(float(np.nanmax(np.abs(residual[kept]))), 1e-3)
        shown = np.clip(residual[outlier], -reach, reach)
        bottom.plot(x[outlier], shown, "x", color=RED, markersize=7.0)
    marks = "red bars: 1 σ of the angle" + (", crosses: do not fit" if outlier.any() else "")
    dress(bottom, xlabel="displacement [µm]", ylabel="residual [°]", title=f"seen − line ({marks})")
    return figure


def axis_per_frame(data: FigureData) -> Figure | str:
    """Where each image puts the axis, in the image plane and out of it."""
    record = data.inputs.goniometer
    if record is None:
        return NOT_MEASURED
    images = record.images.values()
    offset = np.array([image.axis_offset_deg for image in images])
    bars = np.array([image.axis_sigma_deg or (0.0, 0.0) for image in images])
    x = np.arange(1, len(offset) + 1)
    figure = new_figure(8.0, 3.4)
    top, bottom = figure.subplots(2, 1, sharex=True, sharey=True)
    red = " (red: 1 σ)" if bars.any() else ""
    for axes, k, title in (
        (top, 0, f"within the image plane, from x toward y{red}"),
        (bottom, 1, f"out of the image plane, away from the viewer{red}"),
    ):
        axes.axhline(0.0, color=GREY, linewidth=0.8, linestyle="--")
        axes.errorbar(
            x, offset[:, k], yerr=bars[:, k], color=BLUE, linewidth=0.9, marker="o",
            markersize=marker_size(len(x)), elinewidth=0.9, ecolor=RED,
        )  # fmt: skip
        dress(axes, ylabel="axis [°]", title=title)
    bottom.set_xlabel("frame, in the order of acquisition", fontsize=9, color=GREY)
    if not record.in_order:
        bottom.set_xlabel("frame, in the order of rotation", fontsize=9, color=GREY)
    return figure


def specimen_path(data: FigureData) -> Figure | str:
    """The specimen's centre in the image, from frame to frame, and what its moves would be."""
    record = data.inputs.goniometer
    if record is None:
        return NOT_MEASURED
    shift = np.array([image.shift_px for image in record.images.values()])
    figure = new_figure(8.0, 4.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    left.plot(shift[:, 0], shift[:, 1], color=GREY, linewidth=0.7)
    left.scatter(shift[:, 0], shift[:, 1], c=np.arange(len(shift)), cmap="viridis", s=14, zorder=3)
    _number_ends(left, shift)
    middle, reach = 0.5 * (shift.max(axis=0) + shift.min(axis=0)), 0.5 * np.ptp(shift, axis=0)
    half = EQUAL_MARGIN * max(float(reach.max()), 0.5)
    left.set_xlim(middle[0] - half, middle[0] + half)
    left.set_ylim(middle[1] + half, middle[1] - half)
    left.set_aspect("equal")
    dress(left, xlabel="x [px]", ylabel="y [px], down", title="in the image")
    number = np.arange(1, len(shift) + 1)
    size = marker_size(len(shift))
    for k, (name, color) in enumerate((("x", BLUE), ("y", RED))):
        right.plot(
            number, shift[:, k], color=color, linewidth=0.9, marker="o", markersize=size, label=name
        )
    moves = [image.move for image in record.images.values()]
    if all(move is not None for move in moves):
        unit = 1.0
        if record.move_unit == "um" and data.metrics.world.pixel_size_nm is not None:
            unit = 1000.0 / data.metrics.world.pixel_size_nm
        repeated = -unit * np.array(moves, dtype=np.float64)[:, :2]
        repeated += shift.mean(axis=0) - repeated.mean(axis=0)
        right.plot(number, repeated, color=GREY, linewidth=0.9, linestyle="--")
    key(right)
    dress(right, xlabel="frame", ylabel="shift [px]", title="dashed: circle and drift")
    return figure


def _number_ends(axes: Axes, shift: Float) -> None:
    """The first and the last frame's numbers, away from the path's middle."""
    middle = shift.mean(axis=0)
    for k in (0, len(shift) - 1):
        away = shift[k] - middle
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        axes.annotate(
            str(k + 1), shift[k], xytext=(9.0 * away[0], -9.0 * away[1]),
            textcoords="offset points", ha="center", va="center", fontsize=8, color=GREY,
        )  # fmt: skip
