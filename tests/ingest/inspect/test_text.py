from __future__ import annotations

from pathlib import Path

import pytest

from semsfm_colmap.ingest.inspect.inspection import Inspection, inspect_images
from semsfm_colmap.ingest.inspect.rows import InspectionRow
from semsfm_colmap.ingest.inspect.text import format_inspection
from tests.ingest.images import texture
from tests.ingest.inspect.views import OPTIONS, write_series


def row(name: str, **more: object) -> InspectionRow:
    values: dict[str, object] = {
        "width": 1024, "height": 943, "bits": 8, "pixel_size_um": 0.441942,
        "pixel_size_source": "FEI 34682 [EScan] PixelWidth", "tilt_deg": 0.7,
        "stage_rotation_deg": -135.28, "working_distance_um": 11051.0, "beam_energy_kev": 30.0,
        "detector": "LFD", **more,
    }  # fmt: skip
    return InspectionRow(name=name, **values)  # type: ignore[arg-type]


def lines_of(rows: list[InspectionRow], width: int) -> list[str]:
    text = format_inspection(Inspection(rows=tuple(rows), answers=()), width)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    return [line for line in lines if line]


def test_the_table_leaves_out_empty_columns(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    text = format_inspection(inspect_images(folder, OPTIONS))
    assert text.splitlines()[0].split() == ["file", "size", "bits", "!"]
    assert "all images: no microscope header" in text
    assert "enough images?" in text


@pytest.mark.parametrize("width", [60, 80, 100, 120, 160])
def test_what_is_too_wide_and_the_same_for_all_is_said_above_the_table(width: int) -> None:
    rows = [row(f"tilt_series_{i:03}.tif", tilt_deg=5.0 * i) for i in range(4)]
    lines = lines_of(rows, width)
    if width >= 120:
        assert lines[0].split()[:6] == ["file", "size", "bits", "um/px", "from", "tilt"]
        assert "FEI 34682 [EScan] PixelWidth" in lines[2]
    else:
        assert lines[0].startswith("all images: size 1024 x 943, bits 8")
        assert "FEI 34682 [EScan] PixelWidth" in " ".join(" ".join(lines).split())
        assert [line.split() for line in lines[-2:]] == [
            [f"tilt_series_00{i}.tif", str(5 * i)] for i in (2, 3)
        ]


def test_what_differs_and_does_not_fit_goes_into_a_second_table() -> None:
    rows = [
        row(
            f"some_folder/a_rather_long_name_of_tilt_series_{i:03}.tif", width=1000 + i, bits=8 * i,
            pixel_size_um=0.441942 + i, tilt_deg=5.123 * i, stage_rotation_deg=-135.28 * i,
            pixel_size_source=f"FEI 34682 [EScan {i}] PixelWidth", working_distance_um=11051.0 * i,
            beam_energy_kev=10.0 + i, detector=f"LFD{i}",
        )
        for i in (1, 2)
    ]  # fmt: skip
    one = lines_of(rows, 160)
    assert len(one) == 4
    two = lines_of(rows, 80)
    assert len(two) == 8
    assert two[4].split()[0] == "file"
    assert all(line.startswith("…") for line in (*two[2:4], *two[6:8]))
    assert two[0].split() + two[4].split()[1:] == one[0].split()
