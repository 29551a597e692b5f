"""Databases as other programs fill them, for tests: COLMAP 3.8 by plain sqlite3, 4.x by pycolmap.

The 3.8 schema is that of COLMAP's documentation ("Database Format") and of its 3.8 release's
scripts/python/database.py: qvec and tvec priors with the images, no rigs, no frames.
"""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.synthetic.tracks import SimulatedTracks, simulate_tracks
from semsfm_colmap.types import Float, Int

MAX_IMAGE_ID = 2**31 - 1
CALIBRATED = 2
SIMPLE_RADIAL = 2

SCHEMA_38 = """
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Content:
    """What goes into a database; image k has the id ``ids[k]``."""

    names: tuple[str, ...]
    ids: tuple[int, ...]
    size: tuple[int, int]
    keypoints: tuple[Float, ...]
    """(K, 2 to 6) of each image"""
    raw: dict[tuple[int, int], Int] = field(default_factory=dict)
    """matches by image numbers"""
    verified: dict[tuple[int, int], Int] = field(default_factory=dict)

    def stored(self, matches: dict[tuple[int, int], Int]) -> dict[tuple[int, int], Int]:
        """The same by image ids, the smaller one first."""
        result = {}
        for (i, j), rows in matches.items():
            a, b = self.ids[i], self.ids[j]
            result[(a, b) if a < b else (b, a)] = rows if a < b else rows[:, ::-1]
        return result


def write_38(path: Path, content: Content, *, version: int = 3800, wal: bool = False) -> Path:
    """A database of COLMAP 3.8, or of an importer in Python (version 0)."""
    db = sqlite3.connect(path)
    if wal:
        db.execute("PRAGMA journal_mode=WAL")
    db.executescript(SCHEMA_38)
    db.execute(f"PRAGMA user_version = {version}")
    params = np.array([1.2 * content.size[0], content.size[0] / 2, content.size[1] / 2, 0.0])
    db.execute(
        "INSERT INTO cameras VALUES (1, ?, ?, ?, ?, 0)",
        (SIMPLE_RADIAL, *content.size, params.tobytes()),
    )
    for name, image_id, keypoints in zip(
        content.names, content.ids, content.keypoints, strict=True
    ):
        prior = (None,) * 7
        db.execute("INSERT INTO images VALUES (?,?,1,?,?,?,?,?,?,?)", (image_id, name, *prior))
        data = np.asarray(keypoints, dtype=np.float32)
        db.execute(
            "INSERT INTO keypoints VALUES (?,?,?,?)", (image_id, *data.shape, data.tobytes())
        )
    for (a, b), rows in content.stored(content.raw).items():
        data = np.ascontiguousarray(rows, dtype=np.uint32)
        db.execute(
            "INSERT INTO matches VALUES (?,?,?,?)",
            (MAX_IMAGE_ID * a + b, *data.shape, data.tobytes()),
        )
    for (a, b), rows in content.stored(content.verified).items():
        data = np.ascontiguousarray(rows, dtype=np.uint32)
        # COLMAP's own perspective verdict; what stands in F, E, H is not for parallel projection
        nonsense = np.arange(9.0).tobytes()
        db.execute(
            "INSERT INTO two_view_geometries VALUES (?,?,?,?,?,?,?,?,?,?)",
            (
                *(MAX_IMAGE_ID * a + b, *data.shape, data.tobytes(), CALIBRATED),
                *(nonsense, nonsense, nonsense, np.zeros(4).tobytes(), np.zeros(3).tobytes()),
            ),
        )
    db.commit()
    db.close()
    return path


POSE_PRIORS_311 = """
CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, position BLOB,
    coordinate_system INTEGER NOT NULL, position_covariance BLOB,
    FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
"""
RIGS_312 = """
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    ref_sensor_id INTEGER NOT NULL, ref_sensor_type INTEGER NOT NULL);
CREATE TABLE rig_sensors (rig_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
    sensor_type INTEGER NOT NULL, sensor_from_rig BLOB,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
    rig_id INTEGER NOT NULL, FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL,
    sensor_id INTEGER NOT NULL, sensor_type INTEGER NOT NULL,
    FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
INSERT INTO rigs VALUES (1, 1, 0);
INSERT INTO frames SELECT image_id, 1 FROM images;
INSERT INTO frame_data SELECT image_id, image_id, 1, 0 FROM images;
"""


def write_311(path: Path, content: Content) -> Path:
    """A database of 3.10 or 3.11: priors of poses in a table of their own."""
    return _changed(write_38(path, content, version=4100), POSE_PRIORS_311)


def write_312(path: Path, content: Content) -> Path:
    """A database of 3.12 or 3.13: rigs and frames, no priors beside the images."""
    columns = [f"prior_{name}" for name in ("qw", "qx", "qy", "qz", "tx", "ty", "tz")]
    without = "".join(f"ALTER TABLE images DROP COLUMN {name};" for name in columns)
    return _changed(write_38(path, content, version=4200), POSE_PRIORS_311 + without + RIGS_312)


def _changed(path: Path, script: str) -> Path:
    db = sqlite3.connect(path)
    db.executescript(script)
    db.close()
    return path


def write_4x(
    path: Path, content: Content, *, rigs: bool = True, cameras: int = 1, together: int = 1
) -> Path:
    """The same by the installed pycolmap, with or without rigs and frames.

    Parameters
    ----------
    cameras : how many there are, the images in turn of one after the other
    together : so many cameras are a rig, and so many images a frame

    """
    with pycolmap.Database.open(str(path)) as db, pycolmap.DatabaseTransaction(db):
        width, height = content.size
        made = [
            pycolmap.Camera(
                model="SIMPLE_RADIAL", width=width, height=height, camera_id=k + 1,
                params=[1.2 * width, width / 2, height / 2, 0.0],
            )
            for k in range(cameras)
        ]  # fmt: skip
        for camera in made:
            db.write_camera(camera, True)
        for k in range(0, cameras if rigs else 0, together):
            rig = pycolmap.Rig(rig_id=k // together + 1)
            rig.add_ref_sensor(made[k].sensor_id)
            for other in made[k + 1 : k + together]:
                rig.add_sensor(other.sensor_id, pycolmap.Rigid3d())
            db.write_rig(rig, True)
        images = []
        for i, (name, image_id) in enumerate(zip(content.names, content.ids, strict=True)):
            image = pycolmap.Image(name=name, camera_id=i % cameras + 1, image_id=image_id)
            db.write_image(image, True)
            images.append(image)
            db.write_keypoints(image_id, np.asarray(content.keypoints[i], dtype=np.float32))
        if rigs:
            for i in range(0, len(images), together):
                rig_id = i % cameras // together + 1
                frame = pycolmap.Frame(frame_id=images[i].image_id, rig_id=rig_id)
                for image in images[i : i + together]:
                    frame.add_data_id(image.data_id)
                db.write_frame(frame, True)
        for (a, b), rows in content.stored(content.raw).items():
            db.write_matches(a, b, np.ascontiguousarray(rows, dtype=np.uint32))
        for (a, b), rows in content.stored(content.verified).items():
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = int(pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED)
            geometry.F = np.arange(9.0).reshape(3, 3)
            geometry.inlier_matches = np.ascontiguousarray(rows, dtype=np.uint32)
            db.write_two_view_geometry(a, b, geometry)
    return path


def simulated_content(
    *,
    columns: int = 6,
    raw: bool = True,
    verified: bool = True,
    names: tuple[str, ...] | None = None,
    ids: tuple[int, ...] | None = None,
    num_images: int = 8,
    wrong_share: float = 0.1,
) -> tuple[Content, SimulatedTracks]:
    """A turning body as a database knows it: keypoints, and matches of which some are wrong."""
    rng = np.random.default_rng(7)
    tracks = simulate_tracks(
        num_images=num_images, range_deg=70.0, num_tracks=500, noise_px=0.2, rng=rng
    )
    obs = tracks.observations
    order = [rng.permutation(np.flatnonzero(obs.image_idx == i)) for i in range(num_images)]
    keypoints, number = [], {}
    for i, rows in enumerate(order):
        extra = np.tile([2.0, 0.1, -0.1, 2.0], (len(rows), 1))
        keypoints.append(np.hstack([obs.xy[rows], extra])[:, :columns])
        number.update({(i, int(t)): k for k, t in enumerate(obs.track_idx[rows])})
    matches = {}
    for i in range(num_images):
        for j in range(i + 1, num_images):
            rows = np.array([(k, number[j, t]) for (m, t), k in number.items()
                             if m == i and (j, t) in number]).reshape(-1, 2)  # fmt: skip
            wrong = rng.random(len(rows)) < wrong_share
            rows[wrong, 1] = rng.integers(0, len(keypoints[j]), int(wrong.sum()))
            matches[i, j] = rows
    return (
        Content(
            names=names or tuple(f"series a/bild ü {k}.png" for k in range(1, num_images + 1)),
            ids=ids or tuple(range(1, num_images + 1)),
            size=(1000, 1000),
            keypoints=tuple(keypoints),
            raw=matches if raw else {},
            verified=matches if verified else {},
        ),
        tracks,
    )
