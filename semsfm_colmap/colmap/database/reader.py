"""Read any COLMAP database without changing it: schema 3.8 or 4.x, whoever filled it.

pycolmap migrates what it opens, so this reads with plain sqlite3, read-only. What is used:

- ``images`` joined with ``cameras``: names and sizes. Intrinsics, rigs, frames and pose priors say
  nothing about a parallel projection and are ignored.
- ``keypoints``: the first two columns, whatever follows (none, scale and angle, an affine shape).
- ``matches``, and ``inlier_matches`` of the two-view geometries: candidates for the affine
  verification.
- ``descriptors``: only when asked for, image by image.

Arrays are stored as little-endian float32 (keypoints), uint32 (matches) and uint8 (descriptors).
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import numpy as np

from semsfm_colmap.colmap.database.checks import (
    LOCK_TIMEOUT_S,
    check_file,
    check_schema,
    database_sentence,
)
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.names import check_names
from semsfm_colmap.types import Array, Float, Int

MAX_NUM_IMAGES = 2147483647
"""COLMAP's pair_id = MAX_NUM_IMAGES * smaller id + larger id."""
KEYPOINT_COLUMNS = (2, 3, 4, 5, 6)
WAL_MODE = 2
"""Byte 18 of an SQLite header in write-ahead mode; 1 with a rollback journal."""

ImagePair = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class StoredImage:
    """A row of the images table with the size its camera gives it."""

    image_id: int
    name: str
    width_px: int
    height_px: int


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredMatches:
    """The matches of one pair of images, the smaller id first."""

    image_pair: ImagePair
    matches: Int
    """(L, 2) keypoint indices: the raw matches, then verified ones that are not among them"""
    num_raw: int


class DatabaseReader:
    """Reads one open database; made by `read_database`."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self._connection = connection
        self.path = path

    def images(self) -> list[StoredImage]:
        """All images, by id."""
        rows = self._connection.execute(
            "SELECT i.image_id, i.name, c.width, c.height FROM images AS i "
            "LEFT JOIN cameras AS c ON c.camera_id = i.camera_id ORDER BY i.image_id"
        ).fetchall()
        images = []
        for image_id, name, width, height in rows:
            if not isinstance(name, str) or not name:
                raise InputError(f"{self.path}: image {image_id} has no name")
            check_names((name,), self.path)
            if width is None or height is None or width <= 0 or height <= 0:
                raise InputError(
                    f"{self.path}: {name} has no camera with a size, so nothing is known about the "
                    "extent of the image; fill the cameras table"
                )
            images.append(
                StoredImage(
                    image_id=int(image_id), name=name, width_px=int(width), height_px=int(height)
                )
            )
        return images

    def keypoints(self, image_id: int) -> Array:
        """(K, 2 to 6) float32, as stored: x, y px first; (0, 2) where there are none."""
        row = self._connection.execute(
            "SELECT rows, cols, data FROM keypoints WHERE image_id = ?", (image_id,)
        ).fetchone()
        if row is None or not row[0]:
            return np.zeros((0, 2), dtype=np.float32)
        if row[1] not in KEYPOINT_COLUMNS:
            raise InputError(
                f"{self.path}: the keypoints of image {image_id} have {row[1]} columns but 2 to 6 "
                "are expected (x, y and a scale, angle or shape)"
            )
        return self._array(row, np.dtype("<f4"), f"keypoints of image {image_id}")

    def xy(self, image_id: int) -> Float:
        """Keypoint positions (K, 2) px, COLMAP's pixel origin."""
        return np.asarray(self.keypoints(image_id)[:, :2], dtype=np.float64)

    def descriptors(self, image_id: int) -> tuple[int, Array] | None:
        """COLMAP's number of the extractor and (K, bytes) uint8.

        None where there are none, or floats of unknown kind, as some importers store them. Before
        4.0 there was SIFT only, and no number.
        """
        columns = {str(c[1]) for c in self._connection.execute("PRAGMA table_info(descriptors)")}
        if not columns:
            return None
        kind = "type" if "type" in columns else "0"
        row = self._connection.execute(
            f"SELECT rows, cols, data, {kind} FROM descriptors WHERE image_id = ?", (image_id,)
        ).fetchone()
        if row is None or not row[0] or len(row[2] or b"") == 4 * row[0] * row[1]:
            return None
        return int(row[3]), self._array(row[:3], np.dtype("u1"), f"descriptors of image {image_id}")

    def pairs(self) -> list[ImagePair]:
        """The pairs with matches, raw or verified, in order."""
        ids = self._connection.execute(
            "SELECT pair_id FROM matches WHERE rows > 0 "
            "UNION SELECT pair_id FROM two_view_geometries WHERE rows > 0 ORDER BY pair_id"
        )
        return [divmod(int(pair_id), MAX_NUM_IMAGES) for (pair_id,) in ids]

    def matches(self, image_pair: ImagePair, num_keypoints: tuple[int, int]) -> StoredMatches:
        """Raw and verified matches of a pair together, each once.

        Verified ones that are not raw come from guided matching, or from a program that keeps
        nothing else.

        Parameters
        ----------
        num_keypoints : of the two images; matches beyond them are an error

        """
        pair_id = MAX_NUM_IMAGES * image_pair[0] + image_pair[1]
        raw, verified = (
            self._match_table(table, pair_id, image_pair, num_keypoints)
            for table in ("matches", "two_view_geometries")
        )
        both = np.concatenate([raw, verified])
        _, first = np.unique(both, axis=0, return_index=True)
        return StoredMatches(
            image_pair=image_pair,
            matches=both[np.sort(first)],
            num_raw=int(np.sum(first < len(raw))),
        )

    def raw_matches(self, image_pair: ImagePair) -> Int:
        """(L, 2) keypoint indices as the matcher left them."""
        pair_id = MAX_NUM_IMAGES * image_pair[0] + image_pair[1]
        unlimited = MAX_NUM_IMAGES
        return self._match_table("matches", pair_id, image_pair, (unlimited, unlimited))

    def _match_table(
        self, table: str, pair_id: int, image_pair: ImagePair, num_keypoints: tuple[int, int]
    ) -> Int:
        row = self._connection.execute(
            f"SELECT rows, cols, data FROM {table} WHERE pair_id = ?", (pair_id,)
        ).fetchone()
        if row is None or not row[0]:
            return np.zeros((0, 2), dtype=np.int64)
        what = f"matches of images {image_pair[0]} and {image_pair[1]}"
        if row[1] != 2:
            raise InputError(f"{self.path}: the {what} have {row[1]} columns but 2 are expected")
        matches = self._array(row, np.dtype("<u4"), what).astype(np.int64)
        for k in range(2):
            if matches[:, k].max() >= num_keypoints[k]:
                raise InputError(
                    f"{self.path}: the {what} name keypoint {matches[:, k].max()} of image "
                    f"{image_pair[k]}, which has {num_keypoints[k]}: the database is damaged"
                )
        return matches

    def _array(self, row: tuple[int, int, bytes | None], kind: np.dtype, what: str) -> Array:
        rows, cols, data = row
        if len(data or b"") != rows * cols * kind.itemsize:
            raise InputError(
                f"{self.path}: the {what} take {len(data or b'')} bytes but {rows} x {cols} are "
                "recorded: the database is damaged"
            )
        return np.frombuffer(data or b"", dtype=kind).reshape(rows, cols)


@contextmanager
def read_database(path: Path) -> Iterator[DatabaseReader]:
    """Open a COLMAP database for reading only; one sentence when that cannot be.

    Everything read inside is one consistent state, even while another program goes on writing.
    """
    check_file(path)
    try:
        connection = sqlite3.connect(
            database_uri(path), uri=True, timeout=LOCK_TIMEOUT_S, isolation_level=None
        )
        try:
            # names that are not UTF-8 are shown, not a reason to stop
            connection.text_factory = lambda raw: raw.decode("utf-8", "backslashreplace")
            connection.execute("BEGIN")
            check_schema(connection, path)
            yield DatabaseReader(connection, path)
        finally:
            connection.close()
    except sqlite3.Error as error:
        if "readonly" in str(error) and path.with_name(path.name + "-journal").exists():
            raise InputError(
                f"{path} was left in the middle of a transaction by a program that died: open it "
                "once with that program, or run `sqlite3 DATABASE .tables`, to put it right"
            ) from error
        raise InputError(database_sentence(path, error)) from error


def database_uri(path: Path) -> str:
    """The way of opening for reading that leaves no file beside the database.

    In write-ahead mode a reader makes -wal and -shm files, even if it only reads. Where there is
    no -wal file no other program has the database open, and it can be taken as it lies there.
    """
    with path.open("rb") as file:
        file.seek(18)
        wal_mode = file.read(1) == bytes([WAL_MODE])
    alone = not path.with_name(path.name + "-wal").exists()
    access = "immutable=1" if wal_mode and alone else "mode=ro"
    return f"file:{quote(str(path.resolve()))}?{access}"
