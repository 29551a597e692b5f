"""The database that belongs to a model: its ids and cameras, keypoints and verified matches.

COLMAP's programs that go on from a model compare its cameras with those of the database: a model of
pinholes does not fit to a database with, say, SIMPLE_RADIAL cameras, and is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.database.scratch import database_aside
from semsfm_colmap.colmap.database.work import (
    ImagePair,
    open_database,
    transaction,
    write_matches,
    write_two_view_geometries,
)
from semsfm_colmap.colmap.model.rows import open_model, rows_of
from semsfm_colmap.types import Array, Float

FILE_NAME = "database.db"


def write_model_database(
    model_path: Path, geometries: Mapping[ImagePair, tuple[Float, Array]]
) -> Path:
    """Write ``database.db`` into the folder of a model; its path.

    Parameters
    ----------
    geometries : pair of image ids -> fundamental matrix (3, 3), its inlier matches (L, 2); pairs
        with an image that the model does not hold are left out

    """
    model = open_model(model_path)
    rows = rows_of(model).values()
    ids = {row.image_id for row in rows}
    of_model = {pair: found for pair, found in geometries.items() if ids.issuperset(pair)}
    path = model_path / FILE_NAME
    with database_aside(path) as aside:
        size = sum(row.keypoints.size * np.dtype(np.float32).itemsize for row in rows)
        num_rows = 3 * len(ids) + len(model.cameras) + len(model.rigs)
        with open_database(aside, create=True) as db, transaction(db, aside, num_rows, size):
            for camera in model.cameras.values():
                db.write_camera(camera, True)
            for rig in model.rigs.values():
                db.write_rig(rig, True)
            for frame in model.frames.values():
                db.write_frame(frame, True)
            for image_id in sorted(ids):
                db.write_image(model.images[image_id], True)
            for row in rows:
                db.write_keypoints(row.image_id, row.keypoints.astype(np.float32))
        write_matches(aside, {pair: matches for pair, (_, matches) in of_model.items()})
        write_two_view_geometries(aside, of_model)
    return path
