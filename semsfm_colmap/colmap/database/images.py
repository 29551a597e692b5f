"""Cameras, rigs, frames and images of a new working database."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from semsfm_colmap.colmap.database.work import open_database, transaction
from semsfm_colmap.colmap.library import pycolmap

DATABASE_FOCAL_FACTOR = 100.0
"""Focal length written with the images, in units of the image width: long, so that a mapper that
starts from this database starts near parallel projection."""


def register_images(
    database_path: Path, names: Sequence[str], sizes_px: Sequence[tuple[int, int]]
) -> None:
    """Write cameras, rigs, frames and images, in one transaction, where there are none yet.

    Done before extraction, so that image ids follow the order of the names and not that of the
    threads that finish first. One camera a size of image.
    """
    with open_database(database_path, create=True) as db:
        if db.num_images() > 0:
            return
        rows = 2 * len(names) + 2 * len(set(sizes_px))
        with transaction(db, database_path, rows, 0):
            camera_of: dict[tuple[int, int], int] = {}
            for number, (width, height) in enumerate(dict.fromkeys(sizes_px), start=1):
                camera = pycolmap.Camera(
                    model="SIMPLE_PINHOLE",
                    width=width,
                    height=height,
                    params=[DATABASE_FOCAL_FACTOR * width, width / 2.0, height / 2.0],
                    camera_id=number,
                )
                camera_of[width, height] = db.write_camera(camera, True)
                rig = pycolmap.Rig(rig_id=number)
                rig.add_ref_sensor(camera.sensor_id)
                db.write_rig(rig, True)
            for number, (name, size) in enumerate(zip(names, sizes_px, strict=True), start=1):
                image = pycolmap.Image(name=name, camera_id=camera_of[size], image_id=number)
                db.write_image(image, True)
                frame = pycolmap.Frame(frame_id=number, rig_id=camera_of[size])
                frame.add_data_id(image.data_id)
                db.write_frame(frame, True)
