"""Render a series, take it to a model, and compare that with the exact truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.truth.pulls import measure
from benchmarks.truth.series import Series
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.series import synthesize

STAGES = ("ingest", "extract", "match", "map")
"""Of a model; the last one is run anew where that is asked for."""


def rendered(home: Path, series: Series) -> None:
    """The series below `home`, where it is not there yet."""
    if not (home / "series" / "truth.json").is_file():
        synthesize(home / "series", series.options)


def measured(project: Path, series: Path, config: Config, *, again: bool) -> dict[str, Any]:
    """Errors and pulls of a series, or why it gives no model; matches that are there are kept."""
    try:
        run_stages(project, config, names=STAGES[:-1], image_path=series / "images")
        record = run_stages(project, config, names=STAGES[-1:], force=again)
        found = measure(project / "sparse" / "0", series)
        return {**found, "map_seconds": record.stages["map"].seconds}
    except InputError as error:
        return {"failure": str(error)}


def one(series: Series, folder: Path, *, again: bool, num_threads: int) -> dict[str, Any]:
    """Render, map and measure a series, or read what was measured before."""
    home = folder / series.name
    result = home / "pulls.json"
    if result.is_file() and not again:
        return dict(json.loads(result.read_text()))
    rendered(home, series)
    config = replace(Config(), num_threads=num_threads)
    found = measured(home / "project", home / "series", config, again=again)
    result.write_text(json.dumps(found))
    return found
