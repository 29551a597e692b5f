"""Text with a line ``x y z`` a measured cell, behind a line that names the unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.files.lengths import unit_of
from semsfm_colmap.metrology.heights.height_map import MAX_CELLS, HeightMap

HEAD = "x y z"
OFF_GRID = 1e-3
"""Of a step: places farther from the nodes of a regular grid are on none."""


def write(height_map: HeightMap, path: Path) -> None:
    """Write the measured cells, row by row; x and y start at 0."""
    row, column = np.nonzero(height_map.measured)
    dx, dy = height_map.spacing
    lines = np.stack([column * dx, row * dy, height_map.z[row, column]], axis=1)
    np.savetxt(path, lines, fmt="%.9g", header=f"{HEAD} {height_map.unit}")


def read(path: Path) -> HeightMap:
    """Read cells of a regular grid; places that are missing are holes."""
    try:
        with path.open(encoding="utf-8") as file:
            head = file.readline().lstrip("#").split()
        lines = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as lines x y z ({error}).") from error
    if head[:3] != HEAD.split() or len(head) != 4 or lines.shape[1] != 3:
        raise InputError(f"{path} does not begin with '# x y z um' (or px): add this line.")
    unit, factor = unit_of(head[3], path)
    place, step, number = [], [], []
    for axis in (0, 1):
        values = np.unique(lines[:, axis])
        gap = np.diff(values)
        gap = gap[gap > OFF_GRID * gap.max(initial=0.0)]
        if not len(gap):
            raise InputError(f"{path} holds a single line of cells: it is no surface.")
        step.append(float(gap.min()))
        cells = (lines[:, axis] - values[0]) / step[-1]
        # neighbours may be missing, and decimals are cut: the step is refined over all cells
        last = int(np.rint(cells.max()))
        step[-1] = float(np.ptp(values)) / last
        cells = (lines[:, axis] - values[0]) / step[-1]
        place.append(np.rint(cells).astype(np.int64))
        number.append(last + 1)
        if np.abs(cells - place[-1]).max() > 100.0 * OFF_GRID:
            raise InputError(f"{path} is not on a regular grid: resample it to one.")
    if number[0] * number[1] > MAX_CELLS:
        raise InputError(f"{path} is not on a regular grid: resample it to one.")
    z = np.full((number[1], number[0]), np.nan)
    z[place[1], place[0]] = lines[:, 2] * factor
    return HeightMap(z=z, spacing=(step[0] * factor, step[1] * factor), unit=unit)
