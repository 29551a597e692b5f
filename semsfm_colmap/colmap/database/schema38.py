"""A database in the schema of COLMAP 3.8, for programs that cannot open one of 4.x.

COLMAP 3.8, which Debian 12 packages, refuses the schema of 4.x. Keypoints, matches
and two-view geometries are stored the same in both; rigs, frames and pose priors did not exist, and
SIFT was the only descriptor.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from semsfm_colmap.colmap.database.checks import database_sentence
from semsfm_colmap.colmap.database.reader import database_uri, read_database
from semsfm_colmap.colmap.database.scratch import database_aside
from semsfm_colmap.errors import InputError, UsageError

VERSION = 3800
NUM_CAMERA_MODELS = 11
"""SIMPLE_PINHOLE (0) to THIN_PRISM_FISHEYE (10)"""
SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    model INTEGER NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB,
    prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
    prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL,
    prior_tx REAL, prior_ty REAL, prior_tz REAL,
    CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL,
    cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB,
    qvec BLOB, tvec BLOB);
"""
COPIES = (
    "INSERT INTO cameras SELECT camera_id, model, width, height, params, prior_focal_length "
    "FROM new.cameras",
    "INSERT INTO images (image_id, name, camera_id) SELECT image_id, name, camera_id "
    "FROM new.images",
    "INSERT INTO keypoints SELECT image_id, rows, cols, data FROM new.keypoints",
    "INSERT INTO matches SELECT pair_id, rows, cols, data FROM new.matches",
    "INSERT INTO two_view_geometries SELECT pair_id, rows, cols, data, config, F, E, H, qvec, tvec "
    "FROM new.two_view_geometries",
)
SIFT_ONLY = (
    "INSERT INTO descriptors SELECT image_id, rows, cols, data FROM new.descriptors WHERE {}"
)


def write_database_38(source: Path, target: Path) -> None:
    """Copy a COLMAP database into the schema of 3.8, aside first, then renamed; ids stay.

    Descriptors that are not SIFT are left out.

    Raises
    ------
    UsageError when `target` exists, InputError when `source` is no COLMAP database or has a camera
    model that 3.8 does not know

    """
    if target.exists():
        raise UsageError(f"{target} exists: give another name, so that nothing is overwritten")
    with read_database(source) as reader:
        if not reader.images():
            raise InputError(f"{source} holds no images")
    try:
        with (
            database_aside(target) as aside,
            closing(
                sqlite3.connect(
                    f"file:{quote(str(aside.resolve()))}", uri=True, isolation_level=None
                )
            ) as db,
        ):
            db.executescript(SCHEMA)
            db.execute(f"PRAGMA user_version = {VERSION}")
            db.execute("ATTACH ? AS new", (database_uri(source),))
            newer = db.execute(
                "SELECT camera_id FROM new.cameras WHERE model >= ?", (NUM_CAMERA_MODELS,)
            ).fetchone()
            if newer is not None:
                raise InputError(
                    f"{source}: COLMAP 3.8 does not know the model of camera {newer[0]}"
                )
            columns = {str(c[1]) for c in db.execute("PRAGMA new.table_info(descriptors)")}
            db.execute("BEGIN")
            for statement in COPIES:
                db.execute(statement)
            if columns:
                db.execute(SIFT_ONLY.format("type = 0" if "type" in columns else "TRUE"))
            db.execute("COMMIT")
    except sqlite3.Error as error:
        raise InputError(database_sentence(source, error)) from error
