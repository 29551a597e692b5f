import argparse

import pytest

from benchmarks import tables

MARK = "<!-- tables: python -m benchmarks.guided -->"
PAGE = f"""# Guided

Words before.

{MARK}

| old |

{tables.END}

Words between.

<!-- tables: python -m benchmarks.other -->

| other |

{tables.END}
Words after, without a blank line and without an end"""


def test_a_table_has_a_line_of_titles_and_a_line_a_row():
    assert tables.table(["a", "b"], [[1, "x"], [2, "y"]]) == (
        "| a | b |\n|---|---|\n| 1 | x |\n| 2 | y |"
    )


def test_only_what_is_between_the_markers_of_the_command_is_replaced(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    tables.put(page, "guided", "| new |\n")
    assert page.read_text(encoding="utf-8") == PAGE.replace("| old |", "| new |")
    assert list(tmp_path.iterdir()) == [page]


def test_the_same_table_again_leaves_the_page_as_it_is():
    once = tables.replaced(PAGE, "guided", "| new |")
    assert tables.replaced(once, "guided", "| new |") == once


def test_a_page_without_the_markers_gets_the_table_at_its_end(tmp_path):
    page = tmp_path / "page.md"
    tables.put(page, "guided", "| new |")
    block = f"{MARK}\n\n| new |\n\n{tables.END}\n"
    assert page.read_text(encoding="utf-8") == block
    page.write_text("Words\n", encoding="utf-8")
    tables.put(page, "guided", "| new |")
    assert page.read_text(encoding="utf-8") == f"Words\n\n{block}"


@pytest.mark.parametrize(
    "page",
    [
        f"{MARK}\n\n| old |\n\nWords that would be lost",
        f"{MARK}\n\n| old |\n\n<!-- tables: python -m benchmarks.other -->\n\n{tables.END}",
        f"{MARK}\n{tables.END}\n{MARK}\n{tables.END}",
    ],
)
def test_markers_that_do_not_say_where_the_table_ends_are_refused(page, tmp_path, capsys):
    with pytest.raises(tables.MarkerError):
        tables.replaced(page, "guided", "| new |")
    file = tmp_path / "page.md"
    file.write_text(page, encoding="utf-8")
    parser = argparse.ArgumentParser()
    tables.add_page_option(parser, "guided")
    with pytest.raises(SystemExit):  # before anything is measured
        parser.parse_args(["--markdown", str(file)])
    assert str(file) in capsys.readouterr().err
