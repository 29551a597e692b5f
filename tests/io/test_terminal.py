"""Names that a terminal would obey."""

import pytest

from semsfm_colmap.io.terminal import printable, printable_line, show, tell

OBEYED = ["\x1b[2J", "\x00", "\x07", "\x08", "\r", "\x7f", "\x9b31m", "\x85", "\u202e", "\u2066",
          "\u2028", "\u200f", "\udcff"]  # fmt: skip


@pytest.mark.parametrize("text", OBEYED, ids=ascii)
def test_what_a_terminal_obeys_is_shown_as_an_escape(text):
    shown = printable_line(f"a{text}b.tif")
    assert shown.isprintable()
    assert shown.startswith("a\\")
    assert shown.encode("utf-8").decode() == shown


def test_letters_of_all_languages_and_units_stay():
    text = "Körner 花粉 пыльца µm ± 3° \u00a0→ \u2009 😀"
    assert printable_line(text) == printable(text) == text


def test_a_page_keeps_its_lines_and_a_sentence_has_one():
    assert printable("a\n\tb\x1b") == "a\n\tb\\x1b"
    assert printable_line("a\n\tb") == "a\\n\\tb"


def test_both_streams_are_clean(capsys):
    show("a\x1bb\nc")
    tell("d\x9be\nf")
    out, err = capsys.readouterr()
    assert (out, err) == ("a\\x1bb\nc\n", "d\\x9be\\nf\n")
