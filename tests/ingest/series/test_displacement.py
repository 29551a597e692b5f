import numpy as np
import pytest

from semsfm_colmap.errors import InputError, SemSfmError
from semsfm_colmap.ingest.series.displacement import read_displacements

NAMES = ("a.png", "b.png", "c.png")


def write(path, text):
    file = path / "d.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_displacements_come_in_the_order_of_the_images_and_names_need_no_suffix(tmp_path):
    file = write(tmp_path, "image,displacement_um\nc,0.3\na.tif,0.1\nb,0.2\n")
    value, remarks = read_displacements(file, NAMES)
    np.testing.assert_array_equal(value, [0.1, 0.2, 0.3])
    assert remarks == []


def test_lines_and_cells_that_are_missing_are_named_and_the_rest_is_used(tmp_path):
    file = write(tmp_path, "image,displacement_um\na.png,0.1\nb.png,\nz.png,0.4\n")
    with pytest.raises(InputError, match="for all images"):
        read_displacements(file, NAMES)
    file = write(tmp_path, "image,displacement_um\na.png,0.1\nb.png,\nd.png,0.4\nz.png,1\n")
    value, remarks = read_displacements(file, (*NAMES, "d.png"))
    np.testing.assert_array_equal(value, [0.1, np.nan, np.nan, 0.4])
    assert len(remarks) == 3
    assert "not there: z.png" in remarks[0]
    assert "no line for: c.png" in remarks[1]
    assert "no displacement_um for b.png" in remarks[2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("name,displacement_um\na.png,1\n", "needs one named image"),
        ("image,elongation\na.png,1\n", "no value in a column displacement_um"),
        ("image,displacement_nm\na.png,100\n", "displacement_nm"),
        ("image,displacement_um\na.png,1\na.png,2\n", "two lines for a.png"),
        ("image,displacement_um\na.png,nan\n", "line 2: displacement_um is 'nan', not a number"),
        ("image,displacement_um\na.png,0.1 um\n", "'0.1 um', not a number"),
        ("image,displacement_um\nx.png,1\ny.png,2\n", "none of the images named"),
        ("image,displacement_um\na.png,1\nb.png,1\nc.png,1\n", "is 1 for all images"),
        ("image,displacement_um\na.png,\nb.png,\nc.png,\n", "no value in a column"),
        ("image,displacement_um\na.png,\nx.png,1\n", "for any of the images mapped"),
    ],
    ids=[
        "empty", "no image column", "no displacement", "another unit", "an image twice", "nan",
        "a unit in the cell", "other images", "constant", "empty cells", "no cell of these images",
    ],
)  # fmt: skip
def test_bad_tables_are_refused_in_one_sentence_that_names_the_file(tmp_path, text, said):
    with pytest.raises(SemSfmError) as error:
        read_displacements(write(tmp_path, text), NAMES)
    sentence = str(error.value)
    assert said in sentence
    assert "d.csv" in sentence
    assert "\n" not in sentence


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SemSfmError, match=r"none\.csv cannot be read"):
        read_displacements(tmp_path / "none.csv", NAMES)
