"""X3P, ISO 25178-72: a zip of XML and binary heights in metres."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.files.lengths import METRES_PER_UM, metres
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.version import __version__


def write(height_map: HeightMap, path: Path) -> None:
    """Write the heights; holes are points that were not measured."""
    import x3pio

    m = metres(height_map, path)
    x3pio.write(
        path,
        height_map.z * m,
        x_scale=height_map.spacing[0] * m,
        y_scale=height_map.spacing[1] * m,
        metadata=x3pio.Metadata.for_software("semsfm_colmap", __version__),
    )


def read(path: Path) -> HeightMap:
    """Read the first layer of a surface on a regular grid."""
    import x3pio

    try:
        found = x3pio.read(path)
    except (x3pio.X3pError, OSError) as error:
        raise InputError(f"{path} cannot be read as X3P ({error}).") from error
    if not isinstance(found, x3pio.Surface) or not found.is_regular_grid:
        raise InputError(f"{path} holds no surface on a regular grid: resample it to one.")
    return HeightMap(
        z=found.layers[0].z / METRES_PER_UM,
        spacing=(
            float(found.header.x.increment) / METRES_PER_UM,
            float(found.header.y.increment) / METRES_PER_UM,
        ),
        unit="um",
    )
