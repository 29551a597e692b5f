"""Text that a terminal shows and does not obey.

File names and headers are other people's: an escape sequence in one may clear the screen, rename
the window or hide the end of a line (C0 and C1 control characters such as U+009B, and those that
turn the direction of writing such as U+202E). They are shown as escapes instead. Half characters,
which stand for bytes of a file name that are not UTF-8, cannot be printed and are shown so too.
"""

from __future__ import annotations

import sys
import unicodedata

SPACE = "Zs"
"""Spaces of all widths, which Python does not count as printable."""


def printable(text: str) -> str:
    r"""A page of text without what a terminal would obey; it keeps its lines.

    Examples
    --------
    >>> print(printable("a\x1b[2Jb"))
    a\x1b[2Jb

    """
    return _escaped(text, "\n\t")


def printable_line(text: str) -> str:
    r"""A sentence on one line, whatever the names in it hold.

    Examples
    --------
    >>> print(printable_line("no image a\nb.tif"))
    no image a\nb.tif

    """
    return _escaped(text, "")


def show(page: str, *, end: str = "\n") -> None:
    """Print a page of text to the standard output."""
    print(printable(page), end=end)


def tell(line: str) -> None:
    """Print a line to the standard error."""
    print(printable_line(line), file=sys.stderr, flush=True)


def _escaped(text: str, kept: str) -> str:
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in kept or unicodedata.category(c) == SPACE else _escape(c)
        for c in text
    )


def _escape(character: str) -> str:
    return character.encode("unicode_escape", "surrogatepass").decode("ascii")
