from __future__ import annotations

from math import degrees
from pathlib import Path

import pytest

from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.options import IngestOptions
from tests.conftest import DATA
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.inspect.views import OPTIONS, write_series


def test_rows_hold_what_the_headers_say_in_degrees(folder: Path) -> None:
    for i in range(3):
        tag = vendor.fei(tilt_rad=0.1 * i)
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    (folder / "bad.png").write_bytes(b"")
    rows = {row.name: row for row in inspect_images(folder, OPTIONS).rows}
    row = rows["1.tif"]
    assert (row.width, row.height, row.bits) == (200, 160, 8)
    assert row.tilt_deg == pytest.approx(degrees(0.1))
    assert row.pixel_size_um == pytest.approx(0.025)
    assert row.pixel_size_source == "FEI 34682 [EScan] PixelWidth"
    assert (row.instrument, row.detector, row.tilt_corrected) == ("Quanta FEG", "LFD", False)
    bad = rows["bad.png"]
    assert bad.width is None
    assert "is empty" in bad.warnings[0]


def test_a_table_and_an_option_override_the_rows(folder: Path, tmp_path: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    table = tmp_path / "s.csv"
    table.write_text("image,tilt_deg\n0.png,1.5\n1.png,2.5\n2.png,3.5\n")
    options = IngestOptions(series_csv=table, pixel_size_um=0.1)
    rows = inspect_images(folder, options).rows
    assert [row.tilt_deg for row in rows] == pytest.approx([1.5, 2.5, 3.5])
    assert rows[0].pixel_size_source == "option pixel_size_um"


def test_copies_and_images_that_are_too_small_have_a_row_that_says_so(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    save(folder / "copy.png", texture(1))
    save(folder / "small.png", texture(1)[:20, :20])
    inspection = inspect_images(folder, OPTIONS)
    rows = {row.name: row for row in inspection.rows}
    assert rows["1.png"].warnings == ("the pixels are those of copy.png.",) or rows[
        "copy.png"
    ].warnings == ("the pixels are those of 1.png.",)
    assert rows["small.png"].warnings[0].startswith("20 x 20 pixels are too few")
    assert len(rows) == 5
    assert inspection.answers[0].reason.startswith("3 ")


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_every_file_with_vendor_metadata_has_a_row() -> None:
    inspection = inspect_images(DATA / "sem_metadata", OPTIONS)
    rows = {row.name: row for row in inspection.rows}
    assert len(rows) == 6
    assert rows["tescan-pfib_dataZeroed.tif"].stage_rotation_deg == pytest.approx(30.0)
    assert "every pixel has the value 0" in rows["scios_xml_metadata.tif"].warnings[0]
    broken = rows["quad1image_001_no_beam_scan_or_system_meta.tif"]
    assert broken.pixel_size_um == pytest.approx(0.441942)
    assert "the file is damaged" in broken.warnings[0]
    assert all(row.pixel_size_um for row in inspection.rows)
