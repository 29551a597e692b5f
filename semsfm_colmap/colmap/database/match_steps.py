"""Which filter dropped each raw match: a table of ours beside COLMAP's.

COLMAP keeps raw matches and those that a pair's geometry agrees with; what became of the rest, the
report wants to show. COLMAP and pycolmap pass over tables that they do not know.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.database.checks import check_writable, database_sentence
from semsfm_colmap.colmap.database.work import ImagePair
from semsfm_colmap.errors import InputError
from semsfm_colmap.types import AffineTwoViewGeometry, Array, Int

TABLE = "semsfm_match_steps"


def write_match_steps(path: Path, steps: Iterable[tuple[ImagePair, Array]]) -> None:
    """Replace the steps of all pairs: the smaller id first, a byte for each row of its matches."""
    check_writable(path)
    rows = [(*sorted(pair), np.asarray(step, dtype=np.uint8).tobytes()) for pair, step in steps]
    try:
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(
                f"CREATE TABLE IF NOT EXISTS {TABLE} (image_id1 INTEGER NOT NULL, "
                "image_id2 INTEGER NOT NULL, steps BLOB, PRIMARY KEY (image_id1, image_id2))"
            )
            db.execute(f"DELETE FROM {TABLE}")
            db.executemany(f"INSERT INTO {TABLE} VALUES (?, ?, ?)", rows)
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error


def read_match_steps(path: Path) -> dict[ImagePair, Int]:
    """The steps by pair of image ids, (L,) each; none from a database that has none."""
    try:
        with closing(sqlite3.connect(path)) as db:
            known = db.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (TABLE,)).fetchone()
            if known is None:
                return {}
            return {
                (a, b): np.frombuffer(data, dtype=np.uint8).astype(np.int64)
                for a, b, data in db.execute(f"SELECT image_id1, image_id2, steps FROM {TABLE}")
            }
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error


def stored_steps(
    geometries: Iterable[AffineTwoViewGeometry], image_ids: Sequence[int]
) -> list[tuple[ImagePair, Array]]:
    """What `write_match_steps` takes, of the geometries that tell."""
    return [
        ((image_ids[g.image_pair[0]], image_ids[g.image_pair[1]]), g.step)
        for g in geometries
        if g.step is not None
    ]
