"""Is this file a COLMAP database that may be opened now? One sentence when it is not.

pycolmap asks nothing of the file it opens: it adds its tables to any SQLite file and stamps its own
version over a newer one. So both are looked at before, with plain sqlite3.

COLMAP stamps its version number as ``PRAGMA user_version``: 3800 for 3.8, 4020100 for 4.2.1. A
file made by a script in Python (hloc, importers) carries 0.
"""

from __future__ import annotations

import sqlite3
from importlib.metadata import version
from pathlib import Path

from semsfm_colmap.errors import InputError

SQLITE_HEADER = b"SQLite format 3\0"
TABLES = ("cameras", "images", "keypoints", "matches", "two_view_geometries")
"""What every COLMAP database since 3.4 has."""
MORE_TABLES = (
    "descriptors", "frame_data", "frames", "pose_priors", "rig_sensors", "rigs", "sqlite_sequence",
)  # fmt: skip
LOCK_TIMEOUT_S = 5.0
"""COLMAP holds the lock for the length of a transaction, which is well below a second."""
FIRST_LONG_NUMBER = 1_000_000
"""Since 4.0 a version is major * 10^6 + minor * 10^4 + patch * 10^2; before, major * 10^3 + ..."""


def installed_version_number() -> int:
    """The version that the installed pycolmap stamps on a database."""
    parts = [int("".join(c for c in p if c.isdigit()) or 0) for p in version("pycolmap").split(".")]
    major, minor, patch = (*parts, 0, 0, 0)[:3]
    return major * 1_000_000 + minor * 10_000 + patch * 100


def version_text(number: int) -> str:
    """4020100 -> "4.2.1"."""
    return f"{number // 1_000_000}.{number // 10_000 % 100}.{number // 100 % 100}"


def check_file(path: Path) -> None:
    """Refuse what cannot be an SQLite database: missing, a folder, unreadable, something else."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the database file, e.g. {path / 'database.db'}")
    if not path.is_file():
        raise InputError(f"{path} does not exist: give a COLMAP database")
    try:
        with path.open("rb") as file:
            header = file.read(len(SQLITE_HEADER))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error
    if header != SQLITE_HEADER:
        raise InputError(f"{path} is not a COLMAP database: it is no SQLite file")


def check_schema(connection: sqlite3.Connection, path: Path, *, unfinished: bool = False) -> None:
    """Refuse another program's SQLite file, and the database of a newer COLMAP.

    With `unfinished` the tables may be those that a killed process came to make: pycolmap adds the
    others when it opens the file.
    """
    rows = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    known = {str(name) for (name,) in rows}
    missing = [name for name in TABLES if name not in known]
    if missing and not (unfinished and known <= {*TABLES, *MORE_TABLES}):
        raise InputError(f"{path} is not a COLMAP database: it has no table {missing[0]}")
    number = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if number > installed_version_number() and number >= FIRST_LONG_NUMBER:
        raise InputError(
            f"{path} was written by COLMAP {version_text(number)}, but pycolmap "
            f"{version('pycolmap')} is installed: update it (pip install -U pycolmap)"
        )


def check_writable(
    path: Path, *, unfinished: bool = False, timeout_s: float = LOCK_TIMEOUT_S
) -> None:
    """Refuse a working database that is foreign, too new, damaged, or held by another program.

    The write lock is taken and given back; `timeout_s` is how long another's transaction is
    waited for, because pycolmap itself does not wait.
    """
    check_file(path)
    try:
        connection = sqlite3.connect(path, timeout=timeout_s, isolation_level=None)
        try:
            connection.execute("BEGIN IMMEDIATE")
            check_schema(connection, path, unfinished=unfinished)
            connection.execute("ROLLBACK")
        finally:
            connection.close()
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error


def database_sentence(path: Path, error: Exception) -> str:
    """SQLite's or pycolmap's error as a sentence with the way out."""
    text = " ".join(str(error).split())
    if "locked" in text or "busy" in text:
        return f"{path} is in use by another program (COLMAP's GUI?): close it and run again"
    if "readonly" in text or "read-only" in text:
        return f"{path} cannot be written: change its permissions or copy it to another folder"
    if "malformed" in text or "corrupt" in text:
        return (
            f"{path} is damaged ({text[:200]}): make it again, or repair it with sqlite3 .recover"
        )
    return f"{path} cannot be used as a COLMAP database ({text[:200]}): move it away and run again"
