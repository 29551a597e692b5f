"""Tables of our own in a COLMAP database: what COLMAP's have no room for, and do not mind."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

from semsfm_colmap.colmap.database.checks import check_writable, database_sentence
from semsfm_colmap.errors import InputError


def replace_rows(path: Path, table: str, schema: str, rows: Iterable[tuple[Any, ...]]) -> None:
    """Put rows in place of those that were there, all or none.

    Parameters
    ----------
    schema : the columns as SQL has them, for a database without the table
    rows : a value for each column

    """
    check_writable(path)
    rows = list(rows)
    try:
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(f"CREATE TABLE IF NOT EXISTS {table} ({schema})")
            db.execute(f"DELETE FROM {table}")
            if rows:
                places = ", ".join("?" * len(rows[0]))
                db.executemany(f"INSERT INTO {table} VALUES ({places})", rows)
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error


def read_rows(path: Path, table: str) -> list[tuple[Any, ...]] | None:
    """All rows; None from a database without the table."""
    try:
        with closing(sqlite3.connect(path)) as db:
            known = db.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (table,)).fetchone()
            return None if known is None else db.execute(f"SELECT * FROM {table}").fetchall()
    except sqlite3.Error as error:
        raise InputError(database_sentence(path, error)) from error
