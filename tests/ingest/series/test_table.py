from __future__ import annotations

from pathlib import Path
from time import process_time

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.table import read_series_table
from tests.ingest.series.tables import write_table


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
    rows = read_series_table(write_table(tmp_path / "s.csv", text)).rows
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
        read_series_table(write_table(tmp_path / "s.csv", text))


def test_a_table_that_is_missing_or_not_text_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_series_table(tmp_path / "none.csv")
    (tmp_path / "s.csv").write_bytes(b"image,tilt_deg\n\xff\xfe,3\n")
    with pytest.raises(UsageError, match="not UTF-8"):
        read_series_table(tmp_path / "s.csv")


def test_unknown_columns_are_said_not_swallowed(tmp_path: Path) -> None:
    result = read_series_table(write_table(tmp_path / "s.csv", "image,tilt\na.png,3\n"))
    assert "column tilt is not known" in result.warnings[0]


def test_rows_find_their_images_by_name_file_name_or_stem(tmp_path: Path) -> None:
    text = "image,tilt_deg\nrun/a.tif,1\nb.tif,2\nc,3\n./d.png,4\n"
    rows = read_series_table(write_table(tmp_path / "s.csv", text)).match(
        ["run/a.tif", "run/b.tif", "run/c.tif", "d.png", "run2/a.tif"]
    )
    assert {name: row.tilt_deg for name, row in rows.items()} == {
        "run/a.tif": 1, "run/b.tif": 2, "run/c.tif": 3, "d.png": 4,
    }  # fmt: skip


def test_a_name_that_could_be_two_images_is_given_to_neither(tmp_path: Path) -> None:
    rows = read_series_table(write_table(tmp_path / "s.csv", "image,tilt_deg\na.tif,1\n")).match(
        ["run1/a.tif", "run2/a.tif"]
    )
    assert rows == {}


def test_a_table_for_other_images_is_refused(fei_series: Path, tmp_path: Path) -> None:
    path = write_table(tmp_path / "s.csv", "image,tilt_deg\nx.tif,1\n")
    with pytest.raises(InputError, match=r"none of the images named in .*s\.csv"):
        prepare_series(fei_series, tmp_path / "p", IngestOptions(series_csv=path))


def test_empty_lines_of_a_spreadsheet_are_skipped(tmp_path: Path) -> None:
    rows = read_series_table(
        write_table(tmp_path / "s.csv", "image,tilt_deg\na,1\n,\n,,\nb,2\n")
    ).rows
    assert [(row.image, row.tilt_deg) for row in rows] == [("a", 1.0), ("b", 2.0)]


def test_a_long_table_is_read_in_linear_time(tmp_path: Path) -> None:
    text = "image,tilt_deg\n" + "".join(f"{i:06}.tif,1\n" for i in range(60_000))
    start = process_time()
    assert len(read_series_table(write_table(tmp_path / "s.csv", text)).rows) == 60_000
    assert process_time() - start < 5.0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_titles_in_words_and_other_encodings_are_understood(
    tmp_path: Path, encoding: str, separator: str
) -> None:
    titles = ("Filename", "Tilt (deg)", "Stage rotation [rad]", "Pixel size (nm)")
    cells = ("a.tif", "-10.5", "0.5", "156.25")
    path = tmp_path / "series.csv"
    text = f"{separator.join(titles)}\n{separator.join(cells)}\n"
    if separator == ";":
        text = text.replace(".5", ",5").replace(".25", ",25")
    path.write_bytes(text.encode(encoding))
    table = read_series_table(path)
    (row,) = table.rows
    assert (row.image, row.tilt_deg) == ("a.tif", -10.5)
    assert row.rotation_deg == pytest.approx(28.6479, abs=1e-4)
    assert row.pixel_size_um == pytest.approx(0.15625)
    assert table.warnings == ()


def test_a_column_in_an_unknown_unit_is_said_and_not_used(tmp_path: Path) -> None:
    path = tmp_path / "series.csv"
    path.write_text("image,tilt (nm),pixel size (deg)\na.tif,1,2\n")
    table = read_series_table(path)
    assert table.rows[0].tilt_deg is None
    assert table.rows[0].pixel_size_um is None
    assert "is not known and not used" in table.warnings[0]
