from __future__ import annotations

from math import radians
from pathlib import Path
from time import process_time

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.file import read_series
from semsfm_colmap.ingest.series.table import read_series_table
from tests.ingest import vendor_files as vendor
from tests.ingest.conftest import save, texture, with_databar


def table(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "image,tilt_deg,pixel_size_um\na.png,-30.5,0.02\nb.png,,\n",
        "\ufeffimage;pixel_size_um;tilt_deg\r\na.png;0,02;-30,5\r\nb.png;;\r\n",
        "# taken on Monday\nTilt_deg\tImage\tpixel_size_um\n-30.5\ta.png\t0.02\n\n\tb.png\t\n",
        'image, tilt_deg, pixel_size_um\n"a.png", -30.5, 2e-2\nb.png, ,\n',
    ],
    ids=["comma", "semicolon", "tab", "spaces"],
)
def test_tables_of_every_common_kind_are_read(tmp_path: Path, text: str) -> None:
    rows = read_series_table(table(tmp_path / "s.csv", text)).rows
    assert [row.image for row in rows] == ["a.png", "b.png"]
    assert (rows[0].tilt_deg, rows[0].pixel_size_um) == (-30.5, 0.02)
    assert (rows[1].tilt_deg, rows[1].pixel_size_um) == (None, None)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "needs one named image"),
        ("image,tilt_deg\na,3\nb,x3\n", "line 3: tilt_deg is 'x3', not a number"),
        ("image,tilt_deg\na,nan\n", "line 2: tilt_deg is 'nan', not a number"),
        ("image,tilt_deg\na,1e5\n", "no angle in degrees"),
        ("image,pixel_size_um\na,-1\n", "must be positive"),
        ("image,tilt_deg\n,3\n", "the column image is empty"),
        (",,\n#\n", "is empty"),
        ("# a\n\nimage,tilt_deg\n# b\na,3\n\nb,x3\n", "line 7: tilt_deg is 'x3', not a number"),
        ('image,tilt_deg\n"a\nb",3\nb,x3\n', "line 4: tilt_deg is 'x3', not a number"),
        ("image,tilt_deg\na,3\na,4\n", "two lines for a"),
        ("image\x00,b\n", "not a text file"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        read_series_table(table(tmp_path / "s.csv", text))


def test_a_table_that_is_missing_or_not_text_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_series_table(tmp_path / "none.csv")
    (tmp_path / "s.csv").write_bytes(b"image,tilt_deg\n\xff\xfe,3\n")
    with pytest.raises(UsageError, match="not UTF-8"):
        read_series_table(tmp_path / "s.csv")


def test_unknown_columns_are_said_not_swallowed(tmp_path: Path) -> None:
    result = read_series_table(table(tmp_path / "s.csv", "image,tilt\na.png,3\n"))
    assert "column tilt is not known" in result.warnings[0]


def test_rows_find_their_images_by_name_file_name_or_stem(tmp_path: Path) -> None:
    text = "image,tilt_deg\nrun/a.tif,1\nb.tif,2\nc,3\n./d.png,4\n"
    rows = read_series_table(table(tmp_path / "s.csv", text)).match(
        ["run/a.tif", "run/b.tif", "run/c.tif", "d.png", "run2/a.tif"]
    )
    assert {name: row.tilt_deg for name, row in rows.items()} == {
        "run/a.tif": 1, "run/b.tif": 2, "run/c.tif": 3, "d.png": 4,
    }  # fmt: skip


def test_a_name_that_could_be_two_images_is_given_to_neither(tmp_path: Path) -> None:
    rows = read_series_table(table(tmp_path / "s.csv", "image,tilt_deg\na.tif,1\n")).match(
        ["run1/a.tif", "run2/a.tif"]
    )
    assert rows == {}


@pytest.fixture
def fei_series(folder: Path) -> Path:
    """Four images with FEI headers that say 0.5 rad and 25 nm."""
    for i in range(4):
        image = with_databar(texture(i))
        vendor.write_tiff(folder / f"{i}.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    return folder


def test_the_table_overrides_the_headers_and_is_named_as_source(
    fei_series: Path, tmp_path: Path
) -> None:
    lines = "".join(f"{i}.tif,{5 * i},{10 * i},{0.1 * i},0.0255\n" for i in range(3))
    header = "image,tilt_deg,rotation_deg,displacement_um,pixel_size_um\n"
    path = table(tmp_path / "series.csv", header + lines)
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


def test_a_table_for_other_images_is_refused(fei_series: Path, tmp_path: Path) -> None:
    path = table(tmp_path / "s.csv", "image,tilt_deg\nx.tif,1\n")
    with pytest.raises(InputError, match=r"none of the images named in .*s\.csv"):
        prepare_series(fei_series, tmp_path / "p", IngestOptions(series_csv=path))


def test_the_pixel_size_option_wins_and_the_contradiction_is_said(
    fei_series: Path, tmp_path: Path
) -> None:
    series = prepare_series(fei_series, tmp_path / "p", IngestOptions(pixel_size_um=0.03))
    assert (series.pixel_size_um, series.pixel_size_source) == (0.03, "option pixel_size_um")
    assert "pixel_size_um = 0.03 is used although the files say 0.025." in series.warnings
    assert series.frames[0].metadata.pixel_size_um == pytest.approx(0.025)


def test_images_without_pixel_size_among_others_are_named(fei_series: Path, tmp_path: Path) -> None:
    save(fei_series / "plain.tif", with_databar(texture(9)))
    series = prepare_series(fei_series, tmp_path / "p", IngestOptions())
    assert series.pixel_size_um == pytest.approx(0.025)
    assert any(w.startswith("plain.tif: no pixel size recorded") for w in series.warnings)


def test_changing_scan_rotation_and_tilt_correction_are_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        tag = vendor.fei(
            scan_rotation_rad=radians(10.0 * (i == 1)), tilt_correction="yes" if i == 2 else "no"
        )
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    said = " ".join(series.warnings)
    assert "the scan rotation changes within the series (from 0.0 to 10.0 degrees)" in said
    assert "2.tif: tilt correction was on here but not in the other images." in said


def test_empty_lines_of_a_spreadsheet_are_skipped(tmp_path: Path) -> None:
    rows = read_series_table(table(tmp_path / "s.csv", "image,tilt_deg\na,1\n,\n,,\nb,2\n")).rows
    assert [(row.image, row.tilt_deg) for row in rows] == [("a", 1.0), ("b", 2.0)]


def test_a_long_table_is_read_in_linear_time(tmp_path: Path) -> None:
    text = "image,tilt_deg\n" + "".join(f"{i:06}.tif,1\n" for i in range(60_000))
    start = process_time()
    assert len(read_series_table(table(tmp_path / "s.csv", text)).rows) == 60_000
    assert process_time() - start < 5.0
