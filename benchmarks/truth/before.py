"""Larger series, with the drag and the error bars in parts, and as they were without either."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.tables import table
from benchmarks.truth.measured import measured, rendered
from benchmarks.truth.pulls import rms
from benchmarks.truth.series import Series
from semsfm_colmap.config import Config

PARTS = ("noise", "clustered", "drag", "shading", "models")
HEAD = (
    "series",
    "without drag: error deg",
    "noise alone: sigma deg",
    "pull",
    "error deg",
    "sigma deg",
    "pull",
    " / ".join(PARTS),
    "c px",
    "median rotation deg, without drag -> with",
    "steps, ratio, without drag -> with",
    "rotation pulls",
)


def compared(home: Path, series: Path, *, again: bool, num_threads: int) -> dict[str, Any]:
    """A series mapped as usual, and from the same matches without the drag."""
    result = home / "compared.json"
    if result.is_file() and not again:
        return dict(json.loads(result.read_text()))
    config = replace(Config(), num_threads=num_threads)
    now = measured(home / "project", series, config, again=again)
    plain = home / "project_without_drag"
    shutil.rmtree(plain, ignore_errors=True)
    shutil.copytree(home / "project", plain)
    without = replace(config, refinement=replace(config.refinement, drag_sigma_px=0.0))
    before = measured(plain, series, without, again=True)
    shutil.rmtree(plain)
    result.write_text(json.dumps({"now": now, "before": before}))
    return {"now": now, "before": before}


def row(name: str, found: dict[str, Any]) -> list[str]:
    """A line of the table."""
    now, before = found["now"], found["before"]
    for one in (now, before):
        if "failure" in one:
            return [name, str(one["failure"]), *[""] * (len(HEAD) - 2)]
    noise = before["parts_deg"]["noise"]
    drag = now["drag"]
    return [
        name,
        f"{before['total_error_deg']:+.3f}",
        f"{noise:.3f}",
        f"{before['total_error_deg'] / noise:+.1f}",
        f"{now['total_error_deg']:+.3f}",
        f"{now['total_sigma_deg']:.3f}",
        f"{now['total_pull']:+.2f}",
        " / ".join(f"{now['parts_deg'].get(part, 0.0):.3f}" for part in PARTS),
        f"{drag['coefficient_px']:+.2f} +- {drag['sigma_px']:.2f}" if drag else "-",
        f"{before['rotation_error_median_deg']:.3f} -> {now['rotation_error_median_deg']:.3f}",
        f"{before['step_ratio']:.4f} -> {now['step_ratio']:.4f}",
        f"{rms(now['rotation_pulls']):.2f}",
    ]


def before_and_after(
    series: Iterable[Series],
    folders: Iterable[Path],
    folder: Path,
    *,
    again: bool,
    num_threads: int,
) -> str:
    """The table of some series to render, and of folders that hold images/ and truth.json."""
    homes = [(s.name, folder / s.name.replace(" ", "_").replace(",", ""), s) for s in series]
    rows = []
    for name, home, one in homes:
        rendered(home, one)
        rows.append(
            row(name, compared(home, home / "series", again=again, num_threads=num_threads))
        )
        print(" | ".join(rows[-1][:8]), flush=True)
    for path in folders:
        home = folder / path.name
        rows.append(row(path.name, compared(home, path, again=again, num_threads=num_threads)))
        print(" | ".join(rows[-1][:8]), flush=True)
    return table(HEAD, rows)
