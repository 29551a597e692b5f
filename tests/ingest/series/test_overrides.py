from __future__ import annotations

from math import radians
from pathlib import Path

import pytest

from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.file import read_series
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.series.tables import write_table


def test_the_table_overrides_the_headers_and_is_named_as_source(
    fei_series: Path, tmp_path: Path
) -> None:
    lines = "".join(f"{i}.tif,{5 * i},{10 * i},{0.1 * i},0.0255\n" for i in range(3))
    header = "image,tilt_deg,rotation_deg,displacement_um,pixel_size_um\n"
    path = write_table(tmp_path / "series.csv", header + lines)
    series = prepare_series(fei_series, tmp_path / "p", IngestOptions(series_csv=path))
    second = series.frames[1].metadata
    assert second.tilt_rad == pytest.approx(radians(5))
    assert second.stage_rotation_rad == pytest.approx(radians(10))
    assert second.pixel_size_um == 0.0255
    assert second.source["tilt_rad"] == "table series.csv"
    assert second.source["beam_energy_kev"].startswith("FEI")
    untouched = series.frames[3].metadata
    assert untouched.tilt_rad == 0.5
    assert untouched.pixel_size_um == pytest.approx(0.025)
    said = " ".join(series.warnings)
    assert "series.csv has no line for: 3.tif." in said
    assert "the tilts in series.csv differ from those in the files by up to" in said
    assert "the pixel sizes in series.csv differ from those in the files by up to 2.0%" in said
    again = read_series(tmp_path / "p/series.json")
    assert [f.metadata.displacement_um for f in again.frames] == [0.0, 0.1, 0.2, None]
    assert again.frames[2].metadata.source["displacement_um"] == "table series.csv"


def test_the_scale_bar_gives_the_pixel_size_where_none_is_recorded(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=7.9))
    # with_databar draws the bar from column 110 to 189.
    assert series.pixel_size_um == pytest.approx(7.9 / 79)
    assert series.pixel_size_source == "scale bar: 7.9 um over 79 px"


def test_a_scale_bar_that_contradicts_the_header_is_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        image = with_databar(texture(i))
        vendor.write_tiff(folder / f"{i}.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    agreed = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=79 * 0.025))
    assert not agreed.frames[0].warnings
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=4.0))
    assert series.pixel_size_um == pytest.approx(0.025)
    assert "the scale bar of 4 um is 79 px long" in series.frames[0].warnings[0]


def test_a_scale_bar_over_the_image_gives_the_pixel_size_and_a_missing_one_is_said(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        image = texture(i)
        image[140:144, 20:84] = 255
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=10))
    assert series.pixel_size_um == pytest.approx(10 / 64)
    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    series = prepare_series(folder, tmp_path / "q", IngestOptions(scale_bar_um=10))
    assert series.pixel_size_um is None
    assert "no scale bar was found over the image" in " ".join(series.warnings)


def test_a_bar_of_another_length_than_in_the_other_images_is_not_used(
    folder: Path, tmp_path: Path
) -> None:
    for i, length in enumerate((64, 64, 64, 90)):
        image = texture(i)
        image[140:144, 20 : 20 + length] = 255
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=10))
    assert series.pixel_size_um == pytest.approx(10 / 64)
    assert "3.png: what looks like a scale bar has another length" in " ".join(series.warnings)


def test_an_implausible_scale_bar_is_said_and_not_used(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.tif", with_databar(texture(i)))
        text = vendor.hitachi(marker_nm="2000000").replace("PixelSize=24.80469\r\n", "")
        (folder / f"{i}.txt").write_text(text)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert series.pixel_size_um is None  # 2 mm over 79 px at a magnification of 4000
    assert "mm on the display; it is not used" in " ".join(series.warnings)


def test_a_scale_bar_that_contradicts_the_option_is_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    options = IngestOptions(scale_bar_um=7.9, pixel_size_um=0.2)
    series = prepare_series(folder, tmp_path / "p", options)
    assert series.pixel_size_um == 0.2
    assert "but 0.2 um are given" in " ".join(series.warnings)
