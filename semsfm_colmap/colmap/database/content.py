"""What a database holds, as keys of its tables: the file itself says nothing.

SQLite and pycolmap change bytes of a file whose tables stay as they are, and three stages write
into the same one. Each has a part of its own, which those after it leave alone:

- ``features``: cameras, images, measured keypoints and descriptors;
- ``matches``: raw matches with the filters that dropped them, and verified matches of measured
  keypoints;
- ``guided``: all keypoints and two-view geometries, those that the guided pass adds included.

A file that SQLite finds damaged anywhere holds nothing.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from semsfm_colmap.colmap.database import match_steps, measured
from semsfm_colmap.colmap.database.checks import SQLITE_HEADER
from semsfm_colmap.colmap.database.reader import MAX_NUM_IMAGES

Part = Literal["features", "matches", "guided"]
FLOAT_BYTES = 4
INDEX = np.dtype("<u4")


def content_key(path: Path, part: Part) -> str | None:
    """A key of a part of a database; None where it is missing, damaged or none of COLMAP's.

    Nothing is written; what a killed process left in a journal is taken as SQLite takes it.
    """
    try:
        with _sound(path) as db:
            digest = hashlib.blake2b(digest_size=16)
            for row in PARTS[part](db):
                digest.update(repr(row[:-1]).encode())
                digest.update(row[-1] or b"")
            return digest.hexdigest()
    except (OSError, sqlite3.Error, ValueError, TypeError):
        return None


def is_sound(path: Path) -> bool:
    """Whether SQLite finds nothing wrong with a file that is there."""
    try:
        with _sound(path):
            return True
    except (OSError, sqlite3.Error):
        return False


@contextmanager
def _sound(path: Path) -> Iterator[sqlite3.Connection]:
    """An open database; sqlite3.Error where it is damaged."""
    if path.stat().st_size < len(SQLITE_HEADER):
        # sqlite3 itself takes an empty file for an empty database
        raise sqlite3.DatabaseError("file is cut short")
    with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=rw", uri=True)) as db:
        answer = db.execute("PRAGMA quick_check(1)").fetchone()
        if answer != ("ok",):
            raise sqlite3.DatabaseError(str(answer))
        yield db


def _features(db: sqlite3.Connection) -> Iterator[tuple[Any, ...]]:
    yield from db.execute(
        "SELECT camera_id, model, width, height, params FROM cameras ORDER BY camera_id"
    )
    yield from db.execute("SELECT image_id, name, camera_id, NULL FROM images ORDER BY image_id")
    counts = _measured_counts(db)
    for image_id, rows, cols, data in db.execute(
        "SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id"
    ):
        number = counts.get(image_id, rows)
        yield image_id, number, cols, (data or b"")[: number * cols * FLOAT_BYTES]
    yield from db.execute("SELECT image_id, rows, cols, data FROM descriptors ORDER BY image_id")


def _matches(db: sqlite3.Connection) -> Iterator[tuple[Any, ...]]:
    yield from db.execute("SELECT pair_id, rows, cols, data FROM matches ORDER BY pair_id")
    if _has_table(db, match_steps.TABLE):
        yield from db.execute(f"SELECT * FROM {match_steps.TABLE} ORDER BY 1")
    counts = _measured_counts(db)
    for pair_id, cols, data in db.execute(
        "SELECT pair_id, cols, data FROM two_view_geometries ORDER BY pair_id"
    ):
        pairs = np.frombuffer(data or b"", dtype=INDEX).reshape(-1, cols or 2)
        a, b = divmod(pair_id, MAX_NUM_IMAGES)
        own = pairs[(pairs[:, 0] < counts.get(a, np.inf)) & (pairs[:, 1] < counts.get(b, np.inf))]
        if len(own):
            yield pair_id, len(own), own.tobytes()


def _guided(db: sqlite3.Connection) -> Iterator[tuple[Any, ...]]:
    yield from db.execute("SELECT image_id, rows, cols, data FROM keypoints ORDER BY image_id")
    yield from ((*counts, None) for counts in sorted(_measured_counts(db).items()))
    yield from db.execute(
        "SELECT pair_id, rows, cols, config, F, data FROM two_view_geometries ORDER BY pair_id"
    )


PARTS: Mapping[Part, Callable[[sqlite3.Connection], Iterator[tuple[Any, ...]]]] = {
    "features": _features,
    "matches": _matches,
    "guided": _guided,
}


def _measured_counts(db: sqlite3.Connection) -> dict[int, int]:
    """Measured keypoints by image id; empty where all are."""
    if not _has_table(db, measured.TABLE):
        return {}
    return dict(db.execute(f"SELECT * FROM {measured.TABLE}"))


def _has_table(db: sqlite3.Connection, table: str) -> bool:
    return db.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (table,)).fetchone() is not None
