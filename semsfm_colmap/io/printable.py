"""Text for a terminal: names and headers of others may hold what a terminal obeys.

C0 and C1 controls (escape sequences; U+009B begins one alone), line separators and the marks that
turn the direction of writing are shown as what they are, ``\\x1b``, and not obeyed.
"""

from __future__ import annotations

import unicodedata

OBEYED = {"Cc", "Zl", "Zp", "Cs"}
"""Categories of Unicode: controls, separators of lines and paragraphs, halves of pairs."""
DIRECTION = set("\u200e\u200f\u061c\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Marks that turn the direction of writing."""


def printable(text: str, *, keep: str = "\t") -> str:
    r"""The text with what a terminal would obey written out.

    Parameters
    ----------
    keep : controls that stay: "\n" where a text of ours has lines

    Examples
    --------
    >>> print(printable("a\x1b[31mb\u202e.tif"))
    a\x1b[31mb\u202e.tif

    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        c if c in keep or not (unicodedata.category(c) in OBEYED or c in DIRECTION) else _written(c)
        for c in text
    )


def _written(character: str) -> str:
    return character.encode("unicode_escape", "surrogatepass").decode("ascii")
