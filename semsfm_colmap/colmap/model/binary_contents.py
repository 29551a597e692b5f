"""COLMAP's .bin files read within their size; little-endian, as COLMAP writes them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.model.contents import (
    CAMERA_SENSOR,
    PARAMETERS,
    Contents,
    DamageError,
    ImageEntry,
    PointEntry,
    check_camera,
    check_pose,
    damaged,
    gather,
)
from semsfm_colmap.types import Array

KEYPOINT = np.dtype([("xy", "<f8", 2), ("point", "<u8")])
TRACK = np.dtype("<u4")
CAMERA, IMAGE, POINT = struct.Struct("<IiQQ"), struct.Struct("<I7dI"), struct.Struct("<Q3d3BdQ")
RIG, FRAME, SENSOR = struct.Struct("<II"), struct.Struct("<II7dI"), struct.Struct("<iI")
POSE = struct.Struct("<7d")
DATA = struct.Struct("<iIQ")
COUNT = struct.Struct("<Q")


class Bytes:
    """A file that is read from its start and never beyond its end."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    @property
    def left(self) -> int:
        """Bytes not yet read."""
        return len(self._content) - self._at

    def take(self, kind: struct.Struct) -> tuple[Any, ...]:
        """The next values."""
        if self.left < kind.size:
            raise DamageError("it ends too early")
        values = kind.unpack_from(self._content, self._at)
        self._at += kind.size
        return values

    def count(self, smallest: int) -> int:
        """A number of things that take at least so many bytes each."""
        return self.fits(int(self.take(COUNT)[0]), smallest)

    def fits(self, number: int, smallest: int) -> int:
        """A number of things, refused where the rest of the file cannot hold them."""
        if number * smallest > self.left:
            raise DamageError(
                f"{number} entries are announced, of which {self.left} bytes are there"
            )
        return number

    def array(self, kind: np.dtype[Any], number: int) -> Array:
        """The next `number` values of a kind."""
        self.fits(number, kind.itemsize)
        values = np.frombuffer(self._content, dtype=kind, count=number, offset=self._at)
        self._at += number * kind.itemsize
        return values

    def text(self) -> str:
        """A text that ends with a zero byte."""
        end = self._content.find(b"\0", self._at)
        if end < 0:
            raise DamageError("a name does not end")
        raw = self._content[self._at : end]
        self._at = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise DamageError(f"the name {raw[:60]!r} is not in UTF-8") from error


def read_binary_contents(path: Path) -> Contents:
    """Read the .bin files of a model; InputError when one does not hold what it announces."""
    return gather(
        path,
        "bin",
        _read,
        cameras=_cameras,
        images=_images,
        points=_points,
        rigs=_rigs,
        frames=_frames,
    )


def _read(path: Path, parse: Callable[[Bytes], None]) -> None:
    try:
        file = Bytes(path.read_bytes())
        parse(file)
        if file.left:
            raise DamageError(f"{file.left} bytes are left over at its end")
    except DamageError as error:
        raise damaged(path, error) from error


def _cameras(file: Bytes) -> list[int]:
    ids = []
    for _ in range(file.count(CAMERA.size)):
        camera_id, model, width, height = file.take(CAMERA)
        if not 0 <= model < len(PARAMETERS):
            raise DamageError(f"camera {camera_id} is of kind {model}, which COLMAP does not have")
        parameters = file.array(np.dtype("<f8"), PARAMETERS[model])
        check_camera(camera_id, (width, height), parameters)
        ids.append(camera_id)
    return ids


def _images(file: Bytes) -> list[ImageEntry]:
    images = []
    for _ in range(file.count(IMAGE.size + 1 + COUNT.size)):
        image_id, *pose, camera_id = file.take(IMAGE)
        name = file.text()
        check_pose(np.array(pose), f"the image {name!r}")
        keypoints = file.array(KEYPOINT, file.count(KEYPOINT.itemsize))
        images.append(
            ImageEntry(
                image_id=image_id,
                camera_id=camera_id,
                name=name,
                pose=np.array(pose),
                xy=keypoints["xy"],
                point_id=keypoints["point"],
            )
        )
    return images


def _points(file: Bytes) -> list[PointEntry]:
    points = []
    for _ in range(file.count(POINT.size)):
        point_id, *_, length = file.take(POINT)
        file.fits(length, 2 * TRACK.itemsize)
        track = file.array(TRACK, 2 * length).reshape(-1, 2)
        points.append(PointEntry(point_id=point_id, track=track))
    return points


def _rigs(file: Bytes, rigs: dict[int, list[int]]) -> None:
    for _ in range(file.count(RIG.size)):
        rig_id, number = file.take(RIG)
        if rig_id in rigs:
            raise DamageError(f"rig {rig_id} is there twice")
        sensors = [file.take(SENSOR)] if file.fits(number, SENSOR.size) else []
        for _ in range(number - 1):
            sensors.append(file.take(SENSOR))
            if file.take(struct.Struct("<B"))[0]:
                check_pose(np.array(file.take(POSE)), f"rig {rig_id}")
        rigs[rig_id] = [sensor for kind, sensor in sensors if kind == CAMERA_SENSOR]


def _frames(file: Bytes, frames: dict[int, int], images: list[int]) -> None:
    for _ in range(file.count(FRAME.size)):
        frame_id, rig_id, *pose, number = file.take(FRAME)
        if frame_id in frames:
            raise DamageError(f"frame {frame_id} is there twice")
        check_pose(np.array(pose), f"frame {frame_id}")
        frames[frame_id] = rig_id
        for _ in range(file.fits(number, DATA.size)):
            kind, _, data_id = file.take(DATA)
            if kind == CAMERA_SENSOR:
                images.append(data_id)
