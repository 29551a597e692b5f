import pytest

from semsfm_colmap.report.number_text import count, fixed, listed, number, percent, unit_text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (0.0, "0"),
        (3, "3"),
        (1234567, "1\u202f234\u202f567"),
        (0.42649, "0.426"),
        (-12.345, "−12.3"),
        (64655.2, "64\u202f700"),
        (2.3e-6, "2.30e−06"),
    ],
)
def test_numbers_are_written_for_people(value, text):
    assert number(value) == text


def test_percentages_are_not_rounded_up_to_certainty():
    assert percent(0.9999) == "> 99.9\u202f%"
    assert percent(1.0) == "100.0\u202f%"
    assert percent(0.1234) == "12.3\u202f%"


def test_counts_and_fixed_decimals():
    assert count(1, "image") == "1 image"
    assert count(0, "image") == "0 images"
    assert fixed(-0.001, 2) == "0.00"
    assert fixed(-0.126, 2) == "−0.13"
    assert fixed(None, 2) == "–"
    assert fixed(float("nan"), 2) == "–"


def test_the_first_names_are_listed_and_the_others_counted():
    assert listed(["a", "b"]) == "a, b"
    assert listed([*"abcdefgh"]) == "a, b, c, d, e, f and 2 more"


def test_a_micrometre_is_written_as_one():
    assert unit_text("um") == "µm"
    assert unit_text("px") == "px"
