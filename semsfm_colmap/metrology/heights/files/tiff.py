"""Float TIFF with its scale, as ImageJ has it: pages height and sigma, first row at the top."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.apart import ONE_FILE, DiedError, call_apart
from semsfm_colmap.metrology.heights.files.lengths import unit_of
from semsfm_colmap.metrology.heights.height_map import HeightMap


def write(height_map: HeightMap, path: Path) -> None:
    """Write heights, and sigma where there is one, in the unit of the map; holes are nan."""
    import tifffile

    pages = [height_map.z, *([] if height_map.sigma is None else [height_map.sigma])]
    dx, dy = height_map.spacing
    tifffile.imwrite(
        path,
        np.stack([page[::-1] for page in pages]).astype(np.float32),
        imagej=True,
        resolution=(1.0 / dx, 1.0 / dy),
        metadata={
            "axes": "CYX",
            "unit": "um" if height_map.unit == "um" else "pixel",
            "Labels": ["height", "sigma"][: len(pages)],
        },
    )


def read(path: Path) -> HeightMap:
    """Read the first page as heights and a second one named sigma."""
    try:
        return call_apart(ONE_FILE, decoded, path.absolute())
    except DiedError as died:
        raise InputError(
            f"{path} ended the process that read it ({died}): write it again with the program that "
            "made it"
        ) from died


def decoded(path: Path) -> HeightMap:
    """The same in this process."""
    import tifffile

    try:
        with tifffile.TiffFile(path) as tiff:
            said: dict[str, Any] = tiff.imagej_metadata or {}
            tags = tiff.pages[0].tags
            pages = np.atleast_3d(tiff.asarray().astype(np.float64).T).T
            steps = []
            for name in ("XResolution", "YResolution"):
                cells, length = tags[name].value
                steps.append(length / cells)
    except (tifffile.TiffFileError, KeyError, ZeroDivisionError, OSError) as error:
        raise InputError(f"{path} cannot be read as a TIFF with its scale ({error}).") from error
    unit, factor = unit_of(str(said.get("unit", "")), path)
    labels = said.get("Labels") or []
    sigma = pages[1][::-1] * factor if len(pages) > 1 and "sigma" in labels else None
    return HeightMap(
        z=pages[0][::-1] * factor,
        spacing=(steps[0] * factor, steps[1] * factor),
        unit=unit,
        sigma=sigma,
    )
