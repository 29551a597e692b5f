"""Tables in Markdown, and their places in the pages of docs/.

A table stands between two markers, the first of which names the command that makes it:

    <!-- tables: python -m benchmarks.guided -->
    ...
    <!-- end of tables -->

Only what is between them is ever replaced; the words around them are written by hand.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

from semsfm_colmap.io.atomic import write_text

END = "<!-- end of tables -->"
OPENING = "<!-- tables: "


class MarkerError(ValueError):
    """The markers of a page do not say what is to be replaced."""


def table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown: a line of titles, then a line a row."""
    lines = [line(head), "|" + "---|" * len(head)]
    return "\n".join([*lines, *(line(row) for row in rows)])


def line(cells: Sequence[object]) -> str:
    """One row of a table in Markdown."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def opening(command: str) -> str:
    """The marker in front of the tables of ``python -m benchmarks.<command>``."""
    return f"{OPENING}python -m benchmarks.{command} -->"


def replaced(page: str, command: str, text: str) -> str:
    """A page with `text` between the markers of a command; at its end where it has none."""
    mark = opening(command)
    block = "\n\n".join([mark, text.strip("\n"), END])
    if mark not in page:
        above = page.rstrip("\n")
        return f"{above}\n\n{block}\n" if above else f"{block}\n"
    head, _, rest = page.partition(mark)
    old, end, tail = rest.partition(END)
    if not end or OPENING in old:
        raise MarkerError(f"{mark} is not followed by {END}")
    if mark in tail:
        raise MarkerError(f"{mark} stands there twice")
    return head + block + tail


def put(page: Path, command: str, text: str) -> None:
    """Put tables between their markers in a file, written aside, then renamed."""
    before = page.read_text(encoding="utf-8") if page.is_file() else ""
    write_text(replaced(before, command, text), page)


def add_page_option(parser: argparse.ArgumentParser, *commands: str, flag: str = "") -> None:
    """The option ``--markdown FILE``, which refuses a page with broken markers before a long run.

    Parameters
    ----------
    commands : whose tables will be put into the page
    flag : another name of the option

    """

    def page(text: str) -> Path:
        path = Path(text)
        try:
            before = path.read_text(encoding="utf-8") if path.is_file() else ""
            for command in commands:
                replaced(before, command, "")
        except (OSError, UnicodeDecodeError, MarkerError) as error:
            raise argparse.ArgumentTypeError(f"{path}: {error}") from error
        return path

    parser.add_argument(
        "--markdown",
        *([flag] if flag else []),
        type=page,
        metavar="FILE",
        help="put the tables into this page, between their markers",
    )


def parser(command: str, documentation: str | None) -> argparse.ArgumentParser:
    """The command line of ``python -m benchmarks.<command>``, explained by its documentation."""
    return argparse.ArgumentParser(
        prog=f"python -m benchmarks.{command}",
        description=documentation,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
