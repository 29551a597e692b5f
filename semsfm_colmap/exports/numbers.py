"""Numbers in text files: all their digits, so that they are read back as they were."""

from __future__ import annotations

from semsfm_colmap.types import Float


def digits(row: Float) -> str:
    """Numbers separated by spaces."""
    return " ".join(f"{value:.17g}" for value in row)
