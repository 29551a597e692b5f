"""A database of our own for the length of one step, that no other program knows of.

pycolmap's extraction and matching write from threads of their own; when such a thread finds the
database locked, the whole process aborts. So they work on a scratch database, and what they find
is copied into the working one, where a lock is waited for and then is a sentence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import write_features
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.atomic import file_aside

NO_SIFT = (0, np.zeros((0, 128), dtype=np.uint8))
"""SIFT of an image in which nothing was found: recorded, so that it is not searched again."""


@contextmanager
def scratch_database(beside: Path) -> Iterator[Path]:
    """The path for a new database beside another, removed afterwards, and before if a run died."""
    path = beside.with_name(f".{beside.name}.scratch.part")
    remove_database(path)
    try:
        yield path
    finally:
        remove_database(path)


@contextmanager
def database_aside(path: Path) -> Iterator[Path]:
    """Where to fill a database that takes the place of `path` when the block ends."""
    with file_aside(path) as aside:
        remove_database(aside)
        try:
            yield aside
        except BaseException:
            remove_database(aside)
            raise
        remove_database(path)


def remove_database(path: Path) -> None:
    """Remove a database with its log and index."""
    for suffix in ("-wal", "-shm", ""):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def copy_features(source: Path, target: Path, id_of: Mapping[int, int]) -> None:
    """Keypoints and descriptors of images ``source id -> target id``, one transaction an image."""
    with read_database(source) as reader:
        for source_id, target_id in id_of.items():
            keypoints, descriptors = reader.keypoints(source_id), reader.descriptors(source_id)
            if descriptors is None and len(keypoints):
                raise InputError(
                    f"{source} holds keypoints but no descriptors of image {source_id}: nothing "
                    "can be matched; run `semsfm extract --force`"
                )
            write_features(target, target_id, keypoints, descriptors or NO_SIFT)
