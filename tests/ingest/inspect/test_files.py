from __future__ import annotations

import csv
import json
from pathlib import Path

from semsfm_colmap.ingest.inspect.files import write_inspection_csv, write_inspection_json
from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.inspect.text import format_inspection
from semsfm_colmap.ingest.options import IngestOptions
from tests.ingest.images import save, texture
from tests.ingest.inspect.views import OPTIONS, write_series

FIELDS = [
    "name", "width", "height", "bits", "pixel_size_um", "pixel_size_source", "tilt_deg",
    "stage_rotation_deg", "scan_rotation_deg", "working_distance_um", "beam_energy_kev",
    "magnification", "instrument", "detector", "tilt_corrected", "warnings",
]  # fmt: skip


def test_a_displacement_shows_in_the_text_and_leaves_the_files_as_they_are(
    folder: Path, tmp_path: Path
) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    table = tmp_path / "s.csv"
    table.write_text("image,displacement_um\n0.png,0\n1.png,0.0225\n2.png,0.045\n")
    inspection = inspect_images(folder, IngestOptions(series_csv=table))
    titles, _, first, second, _ = format_inspection(inspection).splitlines()[:5]
    assert "disp um" in titles
    assert first.split()[-2:] == ["0", "1"]
    assert second.split()[-2:] == ["0.0225", "1"]
    write_inspection_json(inspection, tmp_path / "i.json")
    assert [list(row) for row in json.loads((tmp_path / "i.json").read_text())] == [FIELDS] * 3


def test_json_holds_one_object_per_image_with_null_where_nothing_is_known(
    folder: Path, tmp_path: Path
) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    write_inspection_json(inspect_images(folder, OPTIONS), tmp_path / "o/i.json")
    rows = json.loads((tmp_path / "o/i.json").read_text())
    assert [list(row) for row in rows] == [FIELDS] * 3
    assert rows[0]["name"] == "0.png"
    assert rows[0]["tilt_deg"] is None
    assert rows[0]["warnings"] == ["no microscope header"]


def test_csv_holds_one_line_per_image(folder: Path, tmp_path: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    save(folder / 'od"d, 3.png', texture(3))
    write_inspection_csv(inspect_images(folder, OPTIONS), tmp_path / "i.csv")
    with (tmp_path / "i.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == FIELDS
    assert [row["name"] for row in rows] == ["0.png", "1.png", "2.png", 'od"d, 3.png']
    assert (rows[0]["width"], rows[0]["tilt_deg"]) == ("200", "")
