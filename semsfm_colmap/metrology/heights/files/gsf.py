"""Gwyddion Simple Field: a text header and float32 heights, first row at the top."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.files.lengths import METRES_PER_UM, unit_of
from semsfm_colmap.metrology.heights.height_map import HeightMap


def write(height_map: HeightMap, path: Path) -> None:
    """Write the heights in metres, or in px where no pixel size is known; holes are nan."""
    from gsffile import write_gsf

    factor = METRES_PER_UM if height_map.unit == "um" else 1.0
    width, height = height_map.size
    unit = "m" if height_map.unit == "um" else "px"
    write_gsf(
        path,
        np.ascontiguousarray(height_map.z[::-1] * factor, dtype=np.float32),
        {
            "XReal": width * factor,
            "YReal": height * factor,
            "XYUnits": unit,
            "ZUnits": unit,
            "Title": "height",
        },
    )


def read(path: Path) -> HeightMap:
    """Read a field."""
    from gsffile import read_gsf

    try:
        data, said = read_gsf(path)
    except (ValueError, KeyError, OSError) as error:
        raise InputError(f"{path} cannot be read as GSF ({error}).") from error
    unit, factor = unit_of(str(said.get("XYUnits", "")), path)
    if unit_of(str(said.get("ZUnits", "")), path) != (unit, factor):
        raise InputError(f"{path} has other units along z than across: write it in one unit.")
    rows, columns = data.shape
    return HeightMap(
        z=data[::-1].astype(np.float64) * factor,
        spacing=(
            float(said["XReal"]) / columns * factor,
            float(said["YReal"]) / rows * factor,
        ),
        unit=unit,
    )
