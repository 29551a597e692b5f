"""The formats of height maps by the ending of their names."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.metrology.heights.files import gsf, gwyddion, sdf, tiff, x3p, xyz
from semsfm_colmap.metrology.heights.height_map import HeightMap

FORMATS: dict[str, ModuleType] = {
    "x3p": x3p,
    "sdf": sdf,
    "gsf": gsf,
    "gwy": gwyddion,
    "tif": tiff,
    "xyz": xyz,
}


def check_format(name: str) -> str:
    """The name of a format, or a sentence that lists them all."""
    if name not in FORMATS:
        raise UsageError(f"{name} is no format of height maps: take one of {', '.join(FORMATS)}")
    return name


def write_height_map(height_map: HeightMap, path: Path) -> None:
    """Write a height map in the format that the ending of the name says."""
    FORMATS[check_format(path.suffix[1:].lower())].write(height_map, path)


def read_height_map(path: Path) -> HeightMap:
    """Read a height map of any of the formats.

    Raises
    ------
    InputError
        The file is not there, damaged, or says no unit.

    """
    if not path.is_file():
        raise InputError(f"{path} does not exist.")
    found: HeightMap = FORMATS[check_format(path.suffix[1:].lower())].read(path)
    return found
