"""SDF, ISO 25178-71: a short header and heights in metres; binary, revision 1.0, which all read."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.files.lengths import METRES_PER_UM, metres
from semsfm_colmap.metrology.heights.height_map import HeightMap


def write(height_map: HeightMap, path: Path) -> None:
    """Write the heights; holes are points that were not measured."""
    import sdfio

    m = metres(height_map, path)
    sdfio.write(
        path,
        height_map.z * m,
        x_scale=height_map.spacing[0] * m,
        y_scale=height_map.spacing[1] * m,
        metadata=sdfio.Metadata(revision=sdfio.Revision.ISO_1_0, manufacturer_id="semsfm"),
    )


def read(path: Path) -> HeightMap:
    """Read a surface."""
    import sdfio

    try:
        found = sdfio.read(path)
    except (sdfio.SdfError, OSError) as error:
        raise InputError(f"{path} cannot be read as SDF ({error}).") from error
    return HeightMap(
        z=found.data / METRES_PER_UM,
        spacing=(found.header.x_scale / METRES_PER_UM, found.header.y_scale / METRES_PER_UM),
        unit="um",
    )
