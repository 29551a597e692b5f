"""Cells that a spreadsheet would reckon."""

import csv
import io

import pytest

from semsfm_colmap.io.csv_cells import plain_cell, safe_cell, safe_row, safe_rows


@pytest.mark.parametrize("text", ["=1+1", "+a", "-10.tif", "@SUM(A1)", "\t=1", "\r=1", "-", "=-1"])
def test_what_a_spreadsheet_would_reckon_is_quoted_and_read_back(text):
    assert safe_cell(text) == "'" + text
    assert plain_cell(safe_cell(text)) == text


@pytest.mark.parametrize("text", ["", "a=1", "-10.5", "+3e-4", "-inf", "'quoted'", "ü"])
def test_other_text_and_numbers_are_left_alone(text):
    assert safe_cell(text) == text
    assert plain_cell(text) == text


def test_cells_that_are_no_text_are_left_alone_in_a_table():
    rows = [["=a", -1.5, None], ["b", 2, "-c"]]
    assert safe_rows(rows) == [["'=a", -1.5, None], ["b", 2, "'-c"]]
    out = io.StringIO()
    csv.writer(out).writerow(safe_row(["-x, y", 1]))
    assert next(csv.reader([out.getvalue()])) == ["'-x, y", "1"]
