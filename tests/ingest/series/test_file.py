from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from semsfm_colmap.ingest.series.file import read_series, write_series
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries
from tests.ingest.prepared import prepare


def test_series_json_round_trips_exactly(tmp_path: Path) -> None:
    metadata = SemMetadata(
        pixel_size_um=0.1 / 3, tilt_rad=-0.2, stage_xyz_um=(1.0, 2.5, -3.0), tilt_corrected=False,
        instrument="Ä µ", displacement_um=0.0225, source={"tilt_rad": "x"},
    )  # fmt: skip
    frame = SemFrame(
        name="a b/ü.png", width_px=3, height_px=2, source_path="/x", crop_px=(0, 1, 2, 3),
        metadata=metadata, warnings=("w",),
    )  # fmt: skip
    series = SemSeries(frames=(frame,), pixel_size_um=1 / 7, pixel_size_source="s", warnings=("v",))
    write_series(series, tmp_path / "series.json")
    assert asdict(read_series(tmp_path / "series.json")) == asdict(series)


def test_a_damaged_series_file_of_an_earlier_run_does_not_matter(good: Path) -> None:
    prepare(good)
    (good.parent / "project/series.json").write_text('{"format": "semsfm-series", "fra')
    assert len(prepare(good).frames) == 3
