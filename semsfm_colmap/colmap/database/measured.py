"""How many of each image's keypoints were measured: a table of ours beside COLMAP's.

A guided pass puts keypoints behind those that were extracted. Which are which must be known where
they lie, or a second mapping would take the first one's predictions for measurements. COLMAP and
pycolmap pass over tables that they do not know.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from semsfm_colmap.colmap.database.side_tables import read_rows, replace_rows

TABLE = "semsfm_measured_keypoints"
SCHEMA = "image_id INTEGER PRIMARY KEY NOT NULL, num_keypoints INTEGER NOT NULL"


def write_num_measured(path: Path, counts: Mapping[int, int]) -> None:
    """Put the counts by image id in place of those that were there.

    To be called before keypoints are added behind: cut off between the two, the counts are those
    of all keypoints there are.
    """
    replace_rows(path, TABLE, SCHEMA, counts.items())


def read_num_measured(path: Path) -> dict[int, int] | None:
    """The counts by image id; None where the database holds none, and all may be measured."""
    rows = read_rows(path, TABLE)
    return None if rows is None else dict(rows)
