"""Foreign text and long lists in messages."""

from semsfm_colmap.io.wording import abbreviate, one_line


def test_foreign_text_becomes_one_printable_line():
    assert one_line("a\nb\x1b[31m  c\t") == "a b [31m c"


def test_long_text_is_cut():
    assert one_line("x" * 200, 10) == "xxxxxxx..."
    assert one_line("x" * 10, 10) == "x" * 10


def test_a_long_list_says_how_many_more_there_are():
    assert abbreviate(["a", "b"]) == "a, b"
    assert abbreviate(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"
