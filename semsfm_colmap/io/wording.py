"""Words for messages: foreign text made harmless, long lists made short."""

from __future__ import annotations

from collections.abc import Sequence

MAX_QUOTED = 120


def one_line(text: str, limit: int = MAX_QUOTED) -> str:
    """Foreign text as one printable line: no line breaks, no escape sequences, not too long."""
    printable = "".join(c if c.isprintable() else " " for c in text[: 4 * limit])
    line = " ".join(printable.split())
    return line if len(line) <= limit else line[: limit - 3] + "..."


def abbreviate(names: Sequence[str], limit: int = 3) -> str:
    """``a, b, c and 5 more``."""
    shown = ", ".join(one_line(name) for name in names[:limit])
    return shown if len(names) <= limit else f"{shown} and {len(names) - limit} more"
