"""How many of each image's keypoints were measured: a table of ours beside COLMAP's.

A guided pass puts keypoints behind those that were extracted. Which are which must be known where
they lie, or a second mapping would take the first one's predictions for measurements. COLMAP and
pycolmap pass over tables that they do not know.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from semsfm_colmap.colmap.database.checks import check_writable, database_sentence
from semsfm_colmap.errors import InputError

TABLE = "semsfm_measured_keypoints"


def write_num_measured(path: Path, counts: Mapping[int, int]) -> None:
    """Put the counts by image id in place of those that were there.

    To be called before keypoints are added behind: cut off between the two, the counts are those
    of all keypoints there are.
    """
    check_writable(path)
    try:
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(
                f"CREATE TABLE IF NOT EXISTS {TABLE} "
                "(image_id INTEGER PRIMARY KEY NOT NULL, num_keypoints INTEGER NOT NULL)"
            )
            db.execute(f"DELETE FROM {TABLE}")
            db.executemany(f"INSERT INTO {TABLE} VALUES (?, ?)", counts.items())
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error


def read_num_measured(path: Path) -> dict[int, int] | None:
    """The counts by image id; None where the database holds none, and all may be measured."""
    try:
        with closing(sqlite3.connect(path)) as db:
            known = db.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (TABLE,)).fetchone()
            if known is None:
                return None
            return dict(db.execute(f"SELECT image_id, num_keypoints FROM {TABLE}"))
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error
