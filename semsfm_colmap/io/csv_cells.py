"""Cells of CSV tables that no spreadsheet takes for a formula.

A cell that begins with = + - @ is reckoned by spreadsheets when the table is opened, so that the
name of a file may run a command. Such text gets an apostrophe in front, as spreadsheets write it
themselves; numbers are left alone, and what reads our tables takes the apostrophe off again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

_FORMULA = re.compile(r"[=+\-@\t\r]")
_QUOTED = re.compile(r"'[=+\-@\t\r]")


def safe_row(row: Iterable[object]) -> list[object]:
    """The cells of a row, text that a spreadsheet would reckon quoted."""
    return [safe_cell(cell) if isinstance(cell, str) else cell for cell in row]


def safe_rows(rows: Iterable[Sequence[object]]) -> list[list[object]]:
    """The same of many rows."""
    return [safe_row(row) for row in rows]


def safe_cell(text: str) -> str:
    """Text with an apostrophe in front where it would be a formula.

    Examples
    --------
    >>> [safe_cell(t) for t in ("=1+1", "-10.tif", "-10.5", "a=b")]
    ["'=1+1", "'-10.tif", '-10.5', 'a=b']

    """
    return f"'{text}" if _FORMULA.match(text) and not _is_number(text) else text


def plain_cell(text: str) -> str:
    """A cell without the apostrophe that `safe_cell` has put in front."""
    return text[1:] if _QUOTED.match(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
