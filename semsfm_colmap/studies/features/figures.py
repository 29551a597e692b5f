"""The paper's figures 3, 12, 13 and table 1 of a series, and what the truth adds, as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.studies.features.result import StudyResult, mean_of
from semsfm_colmap.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STAGES = (
    ("matched", "matched", "#bcccdc"),
    ("heuristic", "heuristically filtered", "#63a0d4"),
    ("robust", "robustly filtered", "#1f4e79"),
)
COLORS = (
    "#1f4e79",
    "#c05621",
    "#2f855a",
    "#97266d",
    "#b7791f",
    "#4a5568",
    "#2b9dbf",
    "#e53e3e",
    "#6b46c1",
    "#718096",
    "#1a202c",
    "#9ae600",
)
"""A colour a detector, most of them told apart by colour-blind readers."""
MARKERS = "osD^vP*X<>ph"
NUM_ELLIPSES = 250
"""Regions drawn in figure 3: the largest response of an even selection."""


def write_figures(result: StudyResult, folder: Path, first_image: Array) -> list[Path]:
    """Write figure03.png, figure12.png, figure13.png, table1.png and, with truth, truth.png."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "figure03": regions_figure(result, first_image),
        "figure12": counts_figure(result),
        "figure13": frames_figure(result),
        "table1": overlap_figure(result),
    }
    if result.has_truth:
        figures["truth"] = truth_figure(result)
    files = []
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=110)
        files.append(folder / f"{name}.png")
    return files


def _figure(rows: int, columns: int, width_in: float, height_in: float) -> tuple[Figure, Array]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=9, loc="left")
    axes.tick_params(labelsize=8)
    axes.grid(True, axis="y", color="#e2e8f0", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def counts_figure(result: StudyResult) -> Figure:
    """Figure 12: matches per descriptor, a panel per detector."""
    columns = 2 if len(result.detectors) <= 8 else 3
    rows = -(-len(result.detectors) // columns)
    figure, panels = _figure(rows, columns, 5.4 * columns, 2.4 * rows + 0.4)
    top = max((c.matched for c in result.counts), default=1)
    x = np.arange(len(result.descriptors))
    for axes, detector in zip(panels, result.detectors, strict=False):
        for k, (key, label, color) in enumerate(STAGES):
            heights = [
                mean_of(result.select_common(detector, descriptor), key)
                for descriptor in result.descriptors
            ]
            axes.bar(x + 0.27 * (k - 1), heights, 0.27, color=color, label=label)
        axes.set_xticks(x, result.descriptors, rotation=25, ha="right", fontsize=8)
        axes.set_ylim(0, 1.05 * max(top, 1))
        axes.set_ylabel("features per pair", fontsize=8)
        _dress(axes, detector)
    for axes in panels[len(result.detectors) :]:
        axes.set_visible(False)
    panels[0].legend(fontsize=8, frameon=False)
    figure.suptitle(f"{result.series}: features matched between consecutive images", fontsize=10)
    return figure


def frames_figure(result: StudyResult) -> Figure:
    """Figure 13: matches from image to image with SIFT, a line per detector."""
    figure, (axes,) = _figure(1, 1, 8.0, 4.2)
    for k, detector in enumerate(result.detectors):
        counts = result.select(detector, "sift")
        axes.plot(
            [c.first + 1 for c in counts],
            [c.robust for c in counts],
            color=COLORS[k % len(COLORS)],
            marker=MARKERS[k % len(MARKERS)],
            markersize=4,
            linewidth=1.2,
            label=detector,
        )
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("frame", fontsize=9)
    axes.set_ylabel("verified matches with the next one", fontsize=9)
    _dress(axes, f"{result.series}: region detectors with SIFT")
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def overlap_figure(result: StudyResult) -> Figure:
    """Table 1: regions that two detectors share."""
    n = len(result.detectors)
    figure, (axes,) = _figure(1, 1, 1.5 + 0.75 * n, 0.9 + 0.55 * n)
    shares = 100.0 * result.overlap
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for i in range(n):
        for j in range(n):
            color = "white" if shares[i, j] > 55 else "#1a202c"
            axes.text(
                j, i, f"{shares[i, j]:.0f}%", ha="center", va="center", fontsize=9, color=color
            )
    axes.set_xticks(range(n), result.detectors, rotation=30, ha="right", fontsize=8)
    axes.set_yticks(range(n), result.detectors, fontsize=8)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.set_title(f"{result.series}: overlap of detectors", fontsize=9, loc="left")
    return figure


def truth_figure(result: StudyResult) -> Figure:
    """Repeatability and localisation against viewing angle; true matches per descriptor."""
    figure, panels = _figure(1, 3, 14.0, 4.2)
    for k, detector in enumerate(result.detectors):
        entries = result.repeatability.get(detector, ())
        angle = [r.angle_deg for r in entries]
        style = {
            "color": COLORS[k % len(COLORS)],
            "marker": MARKERS[k % len(MARKERS)],
            "markersize": 4,
            "linewidth": 1.2,
        }
        panels[0].plot(angle, [100 * r.share for r in entries], label=detector, **style)
        panels[1].plot(angle, [r.error_px for r in entries], **style)
        panels[2].plot(
            range(len(result.descriptors)),
            [mean_of(result.select_common(detector, d), "true_robust") for d in result.descriptors],
            **style,
        )
    for axes, label in zip(
        panels,
        ("repeated regions, %", "median distance from the true place, px", "true verified matches"),
        strict=True,
    ):
        axes.set_ylim(bottom=0)
        axes.set_ylabel(label, fontsize=9)
        _dress(axes, "")
    for axes in panels[:2]:
        axes.set_xlabel("viewing angle, degrees", fontsize=9)
    panels[2].set_xticks(
        range(len(result.descriptors)), result.descriptors, rotation=25, ha="right", fontsize=8
    )
    figure.legend(loc="outside lower center", ncols=min(len(result.detectors), 8), fontsize=8)
    figure.suptitle(f"{result.series}: against the true surface", fontsize=10)
    return figure


def regions_figure(result: StudyResult, image: Array) -> Figure:
    """Figure 3: regions of the first image, a panel per detector, as ellipses."""
    from matplotlib.collections import PolyCollection

    columns = min(4, len(result.detectors))
    rows = -(-len(result.detectors) // columns)
    h, w = image.shape
    figure, panels = _figure(rows, columns, 3.6 * columns, 3.6 * rows * h / w + 0.3 * rows)
    circle = np.stack([np.cos(t := np.linspace(0, 2 * np.pi, 32)), np.sin(t)])
    for axes, detector, regions in zip(panels, result.detectors, result.first_images, strict=False):
        axes.imshow(image, cmap="gray", extent=(0, w, h, 0), interpolation="bilinear")
        # twice the deviation outlines a blob
        outlines = _thinned(regions, NUM_ELLIPSES)
        rings = outlines[:, None, :2] + 2.0 * np.einsum(
            "kij,jn->kni", outlines[:, 2:].reshape(-1, 2, 2), circle
        )
        axes.add_collection(
            PolyCollection(list(rings), facecolors="none", edgecolors="#ffd166", linewidths=0.7)
        )
        axes.set_xlim(0, w)
        axes.set_ylim(h, 0)
        axes.set_axis_off()
        axes.set_title(f"{detector} ({len(regions)})", fontsize=8, loc="left")
    for axes in panels[len(result.detectors) :]:
        axes.set_visible(False)
    return figure


def _thinned(regions: Array, num: int) -> Array:
    """Every so manieth region, so that the picture stays legible."""
    step = max(1, len(regions) // num)
    rows: Sequence[int] = range(0, len(regions), step)
    return regions[list(rows)]
