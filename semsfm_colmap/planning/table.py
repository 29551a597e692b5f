"""A plan as text for a terminal, and as numbers for a program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from semsfm_colmap.planning.next_angles import MappedSeries, NextAngles
from semsfm_colmap.planning.prediction import Prediction
from semsfm_colmap.planning.series import PlannedSeries
from semsfm_colmap.refinement.uncertainty import RELIEF_PX

FLOOR = (
    "These are sigmas of noise. Not noise, and not lowered by more images: what shading does to\n"
    "the cameras (column shading), and the relief under a point's window, "
    f"{RELIEF_PX:g} px along the\nnormal of each point by itself (docs/truth.md)."
)
SERIES_HEAD = (
    "frames", "step deg", "total deg", "depth sigma px", "um", "worst 5 % px", "rotation deg",
    "shading px", "surface seen",
)  # fmt: skip
NEXT_HEAD = (
    "add", "angle deg", "from the nearest image", "mean px", "median px", "um", "worst 5 % px",
    "rotation deg", "shading px",
)  # fmt: skip


def format_series(planned: Sequence[PlannedSeries], pixel_size_um: float | None) -> str:
    """A line a series."""
    rows = []
    for series in planned:
        size, p = series.size, series.prediction
        rows.append(
            [
                str(size.num_frames),
                f"{size.step_deg:.2f}",
                f"{size.total_deg:g}",
                f"{p.median_px:.3f}",
                _um(p.median_px, pixel_size_um),
                f"{p.worst_px:.3f}",
                f"{p.rotation_deg:.4f}",
                f"{_shading(p):.3f}",
                f"{series.seen_share:.0%}",
            ]
        )
    return _text(SERIES_HEAD, rows) + "\n" + FLOOR + "\n"


def format_next(found: NextAngles, series: MappedSeries, pixel_size_um: float | None) -> str:
    """A line for the series as it is, and one for each image added."""
    rows = [["-", "", "", *_next_cells(found.before, pixel_size_um)]]
    for number, image in enumerate(found.added, start=1):
        place = f"{image.from_nearest_deg:+.1f} from {image.nearest}"
        cells = _next_cells(image.prediction, pixel_size_um)
        rows.append([str(number), f"{image.angle_deg:g}", place, *cells])
    noise = series.noise
    head = (
        f"Angles about the axis of the series, from {series.image_names[0]}; noise "
        f"{noise.noise_px:.3f} px,\nmagnification {100 * noise.scale_sigma:g} %, scan drift "
        f"{noise.drift_sigma_px:g} px; of the points facing an image "
        f"{series.matched_share:.0%} are matched in it."
    )
    return f"{head}\n\n{_text(NEXT_HEAD, rows)}\n{FLOOR}\n"


def series_numbers(
    planned: Sequence[PlannedSeries], pixel_size_um: float | None
) -> list[dict[str, Any]]:
    """One object a series."""
    return [
        {
            "num_frames": series.size.num_frames,
            "step_deg": series.size.step_deg,
            "total_deg": series.size.total_deg,
            "seen_share": series.seen_share,
            **_numbers(series.prediction, pixel_size_um),
        }
        for series in planned
    ]


def next_numbers(
    found: NextAngles, series: MappedSeries, pixel_size_um: float | None
) -> dict[str, Any]:
    """The series as it is, and one object an image added."""
    return {
        "noise_px": series.noise.noise_px,
        "matched_share": series.matched_share,
        "before": _numbers(found.before, pixel_size_um),
        "added": [
            {
                "angle_deg": image.angle_deg,
                "nearest": image.nearest,
                "from_nearest_deg": image.from_nearest_deg,
                **_numbers(image.prediction, pixel_size_um),
            }
            for image in found.added
        ],
        "relief_px": RELIEF_PX,
    }


def _numbers(p: Prediction, pixel_size_um: float | None) -> dict[str, Any]:
    return {
        "depth_sigma_px": p.median_px,
        "depth_sigma_um": None if pixel_size_um is None else p.median_px * pixel_size_um,
        "depth_sigma_mean_px": p.mean_px,
        "depth_sigma_worst_px": p.worst_px,
        "own_px": float(np.median(p.own_px)),
        "cameras_px": float(np.median(p.cameras_px)),
        "shading_px": _shading(p),
        "rotation_sigma_deg": p.rotation_deg,
    }


def _next_cells(p: Prediction, pixel_size_um: float | None) -> list[str]:
    return [
        f"{p.mean_px:.3f}",
        f"{p.median_px:.3f}",
        _um(p.median_px, pixel_size_um),
        f"{p.worst_px:.3f}",
        f"{p.rotation_deg:.4f}",
        f"{_shading(p):.3f}",
    ]


def _shading(p: Prediction) -> float:
    return float(np.median(p.shading_px))


def _um(value_px: float, pixel_size_um: float | None) -> str:
    """A length in micrometres; a dash where the pixel size is not known."""
    return "-" if pixel_size_um is None else f"{value_px * pixel_size_um:.3g}"


def _text(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns, right-aligned."""
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in [head, *rows]
    ]
    return "\n".join(lines) + "\n"
