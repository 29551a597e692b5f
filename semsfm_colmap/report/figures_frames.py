"""Per frame: matches (the paper's figure 14), observations and residuals, angle, scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.figure_style import (
    BLUE,
    GREY,
    LIGHT,
    MAX_MARKED_FRAMES,
    RED,
    FigureData,
    dress,
    frame_axis,
    key,
    marker_size,
    new_figure,
)
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SMALLEST_TOP = 1e-3
"""px or degrees: no axis is stretched further than this."""


def _top(values: Float) -> float:
    """The upper end of an axis that starts at zero; rounding noise stays flat."""
    return 1.15 * max(float(np.nanmax(values)), SMALLEST_TOP)


def _bars(axes: Axes, x: Float, height: Float, color: str, label: str) -> None:
    """Bars with gaps, or one filled outline where they would be thinner than the gaps."""
    height = np.nan_to_num(height)
    if len(x) <= MAX_MARKED_FRAMES:
        axes.bar(x, height, width=0.85, color=color, label=label, linewidth=0)
        return
    filled = np.zeros(int(x[-1]) + 1)
    filled[x.astype(np.int64)] = height
    axes.stairs(filled, np.arange(len(filled) + 1) - 0.5, fill=True, color=color, label=label)


def _curve(data: FigureData, axes: Axes, y: Float, sigma: Float) -> None:
    """A value per registered frame, with one-sigma bars where sigma is known."""
    x, num = data.frames.numbers, len(data.frames.names)
    size = marker_size(num)
    if np.isfinite(sigma).any() and size == 0.0:
        axes.fill_between(x, y - sigma, y + sigma, color=RED, alpha=0.35, linewidth=0)
        axes.plot(x, y, color=BLUE, linewidth=0.9)
    elif np.isfinite(sigma).any():
        axes.errorbar(
            x, y, yerr=np.nan_to_num(sigma), color=BLUE, linewidth=0.9, marker="o",
            markersize=size, elinewidth=0.9, capsize=2.0, ecolor=RED,
        )  # fmt: skip
    else:
        axes.plot(x, y, color=BLUE, linewidth=0.9, marker="o", markersize=size)


def matches_per_frame(data: FigureData) -> Figure | str:
    """Matches with the next frame, and over all pairs of a frame."""
    if not data.inputs.pairs:
        return "no matching statistics were given"
    num = len(data.frames.names)
    x = np.arange(1.0, num + 1.0)
    figure = new_figure(8.0, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True)
    found = data.of_matches(lambda matches: matches.num_matches_to_next)
    verified = data.of_matches(lambda matches: matches.num_verified_matches_to_next)
    _bars(top, x, found, LIGHT, "found")
    _bars(top, x, verified, BLUE, "verified")
    dress(top, ylabel="matches", title="to the next frame")
    found = data.of_matches(lambda matches: matches.num_matches)
    verified = data.of_matches(lambda matches: matches.num_verified_matches)
    _bars(bottom, x, found, LIGHT, "found")
    _bars(bottom, x, verified, BLUE, "verified")
    dress(bottom, ylabel="matches", title="over all pairs of the frame")
    key(top)
    frame_axis(bottom, num)
    return figure


def observations_per_frame(data: FigureData) -> Figure | str:
    """Kept and rejected observations of each frame, and the RMS of the kept ones."""
    if data.metrics.structure.num_observations == 0:
        return "there are no kept observations"
    num, x = len(data.frames.names), data.frames.numbers.astype(float)
    kept = data.of_poses(lambda pose: pose.num_observations)
    dropped = data.of_poses(lambda pose: pose.num_rejected_observations)
    rms = data.of_poses(lambda pose: pose.rms_px)
    figure = new_figure(8.0, 4.6)
    top, bottom = figure.subplots(2, 1, sharex=True)
    _bars(top, x, kept + dropped, LIGHT, "rejected")
    _bars(top, x, kept, BLUE, "kept")
    dress(top, ylabel="observations", title="points seen in the frame")
    key(top)
    _curve(data, bottom, rms, np.full(len(x), np.nan))
    bottom.set_ylim(0.0, _top(rms))
    dress(bottom, ylabel="RMS [px]", title="residual per coordinate")
    frame_axis(bottom, num)
    return figure


def rotation_per_frame(data: FigureData) -> Figure | str:
    """Angle about the fitted axis, the step from the frame before, and the wobble."""
    if data.metrics.rotation is None:
        return "fewer than two images are registered, or nothing rotates"
    angle = data.of_poses(lambda pose: pose.angle_deg)
    sigma = data.of_poses(lambda pose: pose.sigma_angle_deg)
    wobble = data.of_poses(lambda pose: pose.wobble_deg)
    figure = new_figure(8.0, 6.2)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.6, 1.0, 1.0))
    _curve(data, top, angle, sigma)
    known = " (red: 1 σ)" if np.isfinite(sigma).any() else ""
    dress(top, ylabel="angle [°]", title=f"rotation relative to the first frame{known}")
    step = data.of_poses(lambda pose: pose.step_deg)
    step_sigma = np.hypot(sigma, np.concatenate([[np.nan], sigma[:-1]]))
    _curve(data, middle, step, step_sigma)
    middle.axhline(float(np.nanmedian(step)), color=GREY, linewidth=0.8, linestyle="--")
    dress(middle, ylabel="step [°]", title="step from the frame before (dashed: median)")
    _curve(data, bottom, wobble, np.full(len(angle), np.nan))
    bottom.set_ylim(0.0, _top(wobble))
    dress(
        bottom, ylabel="wobble [°]", title="tilt of the axis in this frame against the fitted one"
    )
    frame_axis(bottom, len(data.frames.names))
    return figure


def scale_per_frame(data: FigureData) -> Figure | str:
    """Magnification relative to the median, in percent."""
    if len(data.frames.numbers) < 2:
        return "fewer than two images are registered"
    percent = 100.0 * (data.of_poses(lambda pose: pose.relative_scale) - 1.0)
    sigma = 100.0 * data.of_poses(lambda pose: pose.sigma_relative_scale)
    figure = new_figure(8.0, 2.8)
    axes = figure.subplots()
    _curve(data, axes, percent, sigma)
    reach = float(np.nanmax(np.abs(percent) + np.nan_to_num(sigma)))
    axes.set_ylim(-1.15 * max(reach, 0.01), 1.15 * max(reach, 0.01))
    axes.axhline(0.0, color=GREY, linewidth=0.8, linestyle="--")
    known = " (red: 1 σ)" if np.isfinite(sigma).any() else ""
    dress(axes, ylabel="scale − median [%]", title=f"magnification{known}")
    frame_axis(axes, len(data.frames.names))
    return figure
