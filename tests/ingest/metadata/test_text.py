from __future__ import annotations

import pytest

from semsfm_colmap.ingest.metadata.text import (
    decode,
    flag,
    length_um,
    number,
    number_and_unit,
    read_sections,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5.825 nm", 5.825), ("2.11e-009", 2.11e-9), (" -3 ", -3.0), ("3,5", 3.5), (".5", 0.5),
        ("nan", None), ("inf", None), ("1e999", None), ("", None), (None, None), ("x 5", None),
        ("9" * 50, None), ("1e15", 1e15), ("0x10", 0.0),
    ],
)  # fmt: skip
def test_numbers_are_read_and_absurd_ones_refused(text: str | None, value: float | None) -> None:
    assert number(text) == value


@pytest.mark.parametrize(
    ("text", "um"),
    [("8.5 mm", 8500), ("5.825 nm", 5.825e-3), ("3 \u00b5m", 3), ("3\u03bcm", 3), ("1 m", 1e6),
     ("2 \u00c5", 2e-4), ("500 pm", 5e-4), ("5 furlong", None), ("5", None)],
)  # fmt: skip
def test_lengths_need_a_known_unit(text: str, um: float | None) -> None:
    assert length_um(text) == (pytest.approx(um) if um is not None else None)


def test_units_are_lower_case_and_separate() -> None:
    assert number_and_unit("50.00 K X") == (50.0, "k x")
    assert flag("Yes") is True
    assert flag("off") is False
    assert flag("maybe") is None


def test_sections_take_any_line_ending_and_the_first_of_equal_keys() -> None:
    for end in ("\n", "\r\n", "\r"):
        sections = read_sections(
            end.join(["a=0", "[S]", "k = 1", "k=2", "[T]", "no equals", "x=y=z"])
        )
        assert sections == {"": {"a": "0"}, "S": {"k": "1"}, "T": {"x": "y=z"}}


def test_text_after_padding_zeros_is_ignored_and_bytes_never_fail() -> None:
    assert decode(b"abc\x00\x00\x00\x00rubbish") == "abc"
    assert decode(bytes(range(256))) != ""
