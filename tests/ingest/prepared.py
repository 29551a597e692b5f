"""A prepared series, and what is said of a file that was left out of it."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.types import SemSeries

OPTIONS = IngestOptions()


def prepare(folder: Path, options: IngestOptions = OPTIONS) -> SemSeries:
    """The series in a folder, prepared beside it."""
    return prepare_series(folder, folder.parent / "project", options)


def assert_left_out(series: SemSeries, name: str, sentence: str) -> None:
    """The good images are there, the bad one is named in exactly one sentence."""
    assert series.names == ("good0.png", "good1.png", "good2.png")
    about = [w for w in series.warnings if w.startswith(f"{name}: ")]
    assert len(about) == 1
    assert sentence in about[0]
    assert about[0].rstrip().endswith(".")
    assert "\n" not in about[0]
