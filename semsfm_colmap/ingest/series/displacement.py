"""Displacements of the actuator that turned the specimen, from a table given after mapping.

The table is that of the series (`ingest.series.table`); only its displacements are read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.series.table import match_table, read_series_table
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import Float

COLUMN = "displacement_um"


def read_displacements(path: Path, names: Sequence[str]) -> tuple[Float, list[str]]:
    """Displacements (M,) in um of some images, nan where the table has none; and what is odd.

    Raises
    ------
    UsageError
        The file is no table of images.
    InputError
        It is one, but has no displacements of these images, or all are the same.

    """
    table = read_series_table(path)
    if all(row.displacement_um is None for row in table.rows):
        said = f" ({table.warnings[0].rstrip('.')})" if table.warnings else ""
        raise InputError(
            f"{path} has no value in a column {COLUMN}{said}; name the column so, and give "
            "micrometres."
        )
    rows, warnings = match_table(table, names)
    said_of = [rows[name].displacement_um if name in rows else None for name in names]
    value = np.array([np.nan if v is None else v for v in said_of], dtype=np.float64)
    known = value[np.isfinite(value)]
    if len(known) == 0:
        raise InputError(
            f"{path} has no {COLUMN} for any of the images mapped; its first line names "
            f"{table.rows[0].image}, the first image is {names[0]}."
        )
    if float(np.ptp(known)) == 0.0:
        raise InputError(
            f"{COLUMN} in {path} is {known[0]:g} for all images: no rotation can be related to "
            "it; give the read-out of each image."
        )
    empty = [n for n, v in zip(names, said_of, strict=True) if v is None and n in rows]
    if empty:
        warnings.append(f"{path.name} has no {COLUMN} for {abbreviate(empty)}.")
    return value, warnings
