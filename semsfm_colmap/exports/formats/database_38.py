"""The project's database in the schema of COLMAP 3.8, beside the model that shares its ids."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from semsfm_colmap.colmap.database.schema38 import write_database_38
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.colmap_files import write_telecentric
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary

FILE_NAME = "database.db"


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """database.db, sparse/ with cameras, images, points3D .bin"""
    if scene.database_path is None:
        raise UsageError("the scene has no database: export through semsfm_colmap.export_project")
    if not scene.database_path.is_file():
        raise InputError(f"{scene.database_path} does not exist: run `semsfm match` first")
    target = folder / FILE_NAME
    write_database_38(scene.database_path, target)
    if scene.names != scene.reconstruction.image_names:
        _rename_images(scene, target)
    return write_telecentric(scene, folder / "sparse", options)


def _rename_images(scene: ExportScene, database: Path) -> None:
    """Give the registered images their names in the export; images without a camera keep theirs."""
    with closing(sqlite3.connect(database)) as db:
        # aside first: an old name may be another image's new one
        db.executemany(
            "UPDATE images SET name = ? WHERE image_id = ?",
            [(f"\n{name}", i) for name, i in zip(scene.names, scene.image_ids, strict=True)],
        )
        try:
            db.execute("UPDATE images SET name = substr(name, 2) WHERE name LIKE char(10) || '%'")
        except sqlite3.IntegrityError:
            raise InputError(
                "an image that the model does not hold has one of the plain names already: "
                "leave --plain_names away"
            ) from None
        db.commit()
