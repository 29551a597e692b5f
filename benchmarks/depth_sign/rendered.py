"""Rendered series, from their images to the hand: what simulated tracks do not show."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.depth_sign.calibration import BINS, MIN_CONFIDENCE
from benchmarks.tables import table
from benchmarks.truth.measured import one
from benchmarks.truth.series import Series, series
from semsfm_colmap.synthetic.options import SceneName

SCENES: tuple[SceneName, ...] = ("grain", "clump", "field")
SHAPES = ((5, 20), (8, 40), (12, 60), (18, 80), (24, 115), (6, 12), (7, 30), (9, 40))
MAX_FIELD_DEG = 80
HARD: dict[str, tuple[str, dict[str, float]]] = {
    "strong shading": ("strong", {}),
    "charging": ("usual", {"charging": 1.0}),
    "blur": ("usual", {"psf_px": 2.5}),
    "no background": ("usual", {"zoom": 2.2}),
}
"""Shading of `benchmarks.truth.series`, and further options of the renderer."""
PER_KIND = 10
FIRST_SEED = 401


def hard_series() -> list[tuple[str, Series]]:
    """Ten series of each kind, scenes and shapes in turn, seeds of their own."""
    found = []
    seed = FIRST_SEED
    for kind, (shading, options) in HARD.items():
        for k in range(PER_KIND):
            scene = SCENES[k % len(SCENES)]
            num_images, range_deg = SHAPES[k % len(SHAPES)]
            if scene == "field":
                range_deg = min(range_deg, MAX_FIELD_DEG)
            plain = series(kind, scene, seed, num_images, range_deg, shading)
            name = f"{plain.name}_{kind.replace(' ', '_')}"
            hard = replace(plain, name=name, options=replace(plain.options, **options))  # type: ignore[arg-type]
            found.append((kind, hard))
            seed += 1
    return found


def rendered(folder: Path) -> str:
    """Tables of the hand on the hard series, rendered and mapped below a folder."""
    rows: list[tuple[str, dict[str, Any]]] = []
    for kind, some in hard_series():
        rows.append((kind, one(some, folder, again=False, num_threads=-1)))
        print(f"{some.name}: {told(rows[-1][1])}", flush=True)
    return "\n\n".join([kinds_table(rows), confidence_table(rows)])


def told(found: dict[str, Any]) -> str:
    """What became of one series."""
    if "failure" in found:
        return str(found["failure"])
    return f"{'right' if found['hand_right'] else 'wrong'} at {found['hand_confidence']:.4f}"


def kinds_table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """Resolved right, ambiguous, resolved wrong, no model: by kind."""
    lines: list[list[str | int]] = []
    for kind in dict.fromkeys(kind for kind, _ in rows):
        mine = [found for k, found in rows if k == kind]
        models = [found for found in mine if "failure" not in found]
        sure = [found for found in models if found["hand_confidence"] >= MIN_CONFIDENCE]
        right = sum(found["hand_right"] for found in sure)
        lines.append(
            [
                kind,
                len(mine),
                right,
                len(models) - len(sure),
                len(sure) - right,
                len(mine) - len(models),
            ]
        )
    head = [
        "rendered with",
        "series",
        "resolved, right",
        "ambiguous",
        "resolved, wrong",
        "no model",
    ]
    return table(head, lines)


def confidence_table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """Of the series with a confidence within each bin, how many have the right hand."""
    models = [found for _, found in rows if "failure" not in found]
    lines: list[list[str | int]] = []
    for low, high in itertools.pairwise(BINS):
        inside = [found for found in models if low <= found["hand_confidence"] < high]
        right = sum(found["hand_right"] for found in inside)
        lines.append([f"{low} to {high}", len(inside), right])
    return table(["confidence", "series", "right"], lines)
