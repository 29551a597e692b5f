"""Tables of a series as a person writes them."""

from __future__ import annotations

from pathlib import Path


def write_table(path: Path, text: str) -> Path:
    """A text file; returns its path."""
    path.write_text(text, encoding="utf-8")
    return path
