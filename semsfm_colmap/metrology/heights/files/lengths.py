"""Units of height maps in files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.height_map import HeightMap

METRES_PER_UM = 1e-6


def metres(height_map: HeightMap, path: Path) -> float:
    """Metres of a unit of the map, for a format that knows no other.

    Raises
    ------
    InputError
        The map is in px.

    """
    if height_map.unit != "um":
        raise InputError(
            f"{path.name} would hold metres, but no pixel size is known: write gsf, gwy, tif or "
            "xyz, which keep px, or give a pixel size and map again."
        )
    return METRES_PER_UM


def unit_of(text: str, path: Path) -> tuple[Literal["um", "px"], float]:
    """The unit that a word in a file stands for, and its length in that of the map.

    Raises
    ------
    InputError
        An unknown word.

    """
    word = text.strip().replace("µ", "u").replace("μ", "u")
    if word in ("px", "pixel", "pixels"):
        return "px", 1.0
    known = {"m": 1e6, "mm": 1e3, "um": 1.0, "micron": 1.0, "nm": 1e-3}
    if word not in known:
        raise InputError(f"{path} has lengths in {text!r}: write it in m, mm, um, nm or px.")
    return "um", known[word]
