"""Gwyddion's own files: height and sigma as channels, holes as a mask, first row at the top."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.files.lengths import METRES_PER_UM, unit_of
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.types import Float


def write(height_map: HeightMap, path: Path) -> None:
    """Write heights, and sigma where there is one.

    Gwyddion has no empty cells: holes lie at the mean height, marked by the mask.
    """
    from gwyfile.objects import GwyContainer, GwyDataField

    metres = height_map.unit == "um"
    factor = METRES_PER_UM if metres else 1.0
    width, height = height_map.size
    measured = height_map.measured

    def field(values: Float, *, lengths: bool = True) -> GwyDataField:
        unit = "m" if metres else "px"
        return GwyDataField(
            np.ascontiguousarray(values[::-1], dtype=np.float64),
            xreal=width * factor,
            yreal=height * factor,
            si_unit_xy=unit,
            si_unit_z=unit if lengths else "",
        )

    def filled(values: Float) -> Float:
        return np.where(measured, values, np.nanmean(values)) * factor

    content = GwyContainer()
    content["/0/data/title"] = "height"
    content["/0/data"] = field(filled(height_map.z))
    if not measured.all():
        content["/0/mask"] = field((~measured).astype(float), lengths=False)
    if height_map.sigma is not None:
        content["/1/data/title"] = "sigma"
        content["/1/data"] = field(filled(height_map.sigma))
    content.tofile(str(path))


def read(path: Path) -> HeightMap:
    """Read the first channel, its mask as holes, and a channel named sigma."""
    import struct

    from gwyfile.objects import GwyObject

    try:
        content = GwyObject.fromfile(str(path))
        field = content["/0/data"]
        xy, z = (str(field[key]["unitstr"]) for key in ("si_unit_xy", "si_unit_z"))
    except (AssertionError, KeyError, ValueError, TypeError, struct.error, OSError) as error:
        raise InputError(f"{path} cannot be read as a Gwyddion file ({error!r}).") from error
    unit, factor = unit_of(xy, path)
    if unit_of(z, path) != (unit, factor):
        raise InputError(f"{path} has other units along z than across: write it in one unit.")
    heights = field.data[::-1] * factor
    rows, columns = heights.shape
    hole = (
        content["/0/mask"].data[::-1] > 0.5 if "/0/mask" in content else np.zeros_like(heights) > 0
    )
    sigma = None
    if content.get("/1/data/title") == "sigma":
        sigma = np.where(hole, np.nan, content["/1/data"].data[::-1] * factor)
    return HeightMap(
        z=np.where(hole, np.nan, heights),
        spacing=(field.xreal / columns * factor, field.yreal / rows * factor),
        unit=unit,
        sigma=sigma,
    )
