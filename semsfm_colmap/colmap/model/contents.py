"""A COLMAP model's files looked through before pycolmap gets them.

pycolmap believes every count that it reads: a flipped bit in one of them takes all memory, or never
ends. So all counts are held against the size of the file, and all numbers that point to something
against what is there. `binary_contents.py` and `text_contents.py` read; this compares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.names import check_names
from semsfm_colmap.types import Array, Float

PARAMETERS = (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2)
"""Number of parameters of COLMAP's camera models, by their number."""
MAX_SIDE_PX = 1_000_000
"""No image is larger."""
MAX_NUMBER = 1e30
"""No place or focal length is larger in any unit, and products of four are numbers still."""
CAMERA_SENSOR = 0
"""COLMAP's number of the kind of sensor that a camera is."""
NO_POINT = 2**64 - 1
"""A keypoint of no point."""
CLASSIC = ("cameras", "images", "points3D")
"""The files that every model has; COLMAP 4 has rigs and frames besides."""


class DamageError(Exception):
    """What is wrong with a file; `open_model` says which file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageEntry:
    """One image of images.bin."""

    image_id: int
    camera_id: int
    name: str
    pose: Float
    """(7,) quaternion, translation"""
    xy: Float
    """(K, 2)"""
    point_id: Array
    """(K,) uint64"""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointEntry:
    """One point of points3D.bin."""

    point_id: int
    track: Array
    """(L, 2) uint32 image id, keypoint"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contents:
    """What the files of a model say, as far as it can contradict itself."""

    camera_ids: list[int] = field(default_factory=list)
    images: list[ImageEntry] = field(default_factory=list)
    points: list[PointEntry] = field(default_factory=list)
    rig_cameras: dict[int, list[int]] | None = None
    """Cameras of each rig; None without rigs"""
    frame_rigs: dict[int, int] | None = None
    """The rig of each frame; None without frames"""
    frame_images: list[int] = field(default_factory=list)
    """Images that frames hold"""


def gather(
    path: Path,
    end: str,
    read: Callable[[Path, Callable[[Any], None]], None],
    *,
    cameras: Callable[[Any], Iterable[int]],
    images: Callable[[Any], Iterable[ImageEntry]],
    points: Callable[[Any], Iterable[PointEntry]],
    rigs: Callable[[Any, dict[int, list[int]]], None],
    frames: Callable[[Any, dict[int, int], list[int]], None],
) -> Contents:
    """The contents of a model's files, by the parsers of their format.

    Parameters
    ----------
    end : of the files' names
    read : opens a file for a parser; InputError where the parser meets damage

    """
    has_rigs, has_frames = ((path / f"{name}.{end}").is_file() for name in ("rigs", "frames"))
    contents = Contents(rig_cameras={} if has_rigs else None, frame_rigs={} if has_frames else None)
    read(path / f"cameras.{end}", lambda file: contents.camera_ids.extend(cameras(file)))
    read(path / f"images.{end}", lambda file: contents.images.extend(images(file)))
    read(path / f"points3D.{end}", lambda file: contents.points.extend(points(file)))
    if (of_rigs := contents.rig_cameras) is not None:
        read(path / f"rigs.{end}", lambda file: rigs(file, of_rigs))
    if (of_frames := contents.frame_rigs) is not None:
        read(
            path / f"frames.{end}",
            lambda file: frames(file, of_frames, contents.frame_images),
        )
    return contents


def all_finite(values: Array) -> bool:
    """Whether all are numbers that can be reckoned with: neither nan nor beyond `MAX_NUMBER`."""
    return bool((np.abs(values) < MAX_NUMBER).all())


def check_camera(camera_id: int, size: tuple[int, int], parameters: Iterable[float]) -> None:
    """Refuse a camera that none can be."""
    if not all(0 < side <= MAX_SIDE_PX for side in size):
        raise DamageError(f"camera {camera_id} is {size[0]} x {size[1]} px")
    if not all_finite(np.array(list(parameters))):
        raise DamageError(f"camera {camera_id} has a parameter that is not a finite number")


def check_pose(pose: Float, what: str) -> None:
    """Refuse a pose that is no rotation and translation."""
    if not all_finite(pose) or not 1e-6 < np.abs(pose[:4]).max() < 1e6:
        raise DamageError(f"{what} has a pose that is none")


def check_contents(contents: Contents, path: Path, end: str) -> None:
    """Compare what the files say with one another; InputError names the file that is wrong."""
    try:
        _check_ids(contents.camera_ids, "camera")
        where = "rigs"
        cameras = set(contents.camera_ids)
        for rig_id, of_rig in (contents.rig_cameras or {}).items():
            for camera_id in of_rig:
                if camera_id not in cameras:
                    raise DamageError(f"rig {rig_id} has camera {camera_id}, which is not there")
        where = "images"
        images = {image.image_id: image for image in contents.images}
        _check_ids([image.image_id for image in contents.images], "image")
        for image in contents.images:
            if image.camera_id not in cameras:
                raise DamageError(
                    f"{image.name!r} has camera {image.camera_id}, which is not there"
                )
        where = "frames"
        for frame_id, rig_id in (contents.frame_rigs or {}).items():
            if contents.rig_cameras is not None and rig_id not in contents.rig_cameras:
                raise DamageError(f"frame {frame_id} has rig {rig_id}, which is not there")
        if contents.frame_rigs is not None:
            _check_ids(contents.frame_images, "image")
            apart = images.keys() - set(contents.frame_images)
            if apart:
                raise DamageError(f"image {min(apart)} is in no frame")
        where = "points3D"
        _check_ids([point.point_id for point in contents.points], "point")
        _check_tracks(contents.points, images)
        where = "images"
        points = {point.point_id for point in contents.points}
        for image in contents.images:
            if not all_finite(image.xy[image.point_id != NO_POINT]):
                raise DamageError(f"{image.name!r} sees a point at a place that is not finite")
            named = set(image.point_id[image.point_id != NO_POINT].tolist())
            if not named <= points:
                raise DamageError(f"{image.name!r} shows point {min(named - points)}, "
                              "which is not there")  # fmt: skip
    except DamageError as error:
        raise damaged(path / f"{where}.{end}", error) from error
    check_names((image.name for image in contents.images), path / f"images.{end}")


def damaged(file: Path, error: DamageError) -> InputError:
    """The sentence about a file."""
    return InputError(
        f"{file} is damaged ({error}): write the model again with the program that made it"
    )


def _check_ids(ids: list[int], what: str) -> None:
    twice = [number for number, times in Counter(ids).items() if times > 1]
    if twice:
        raise DamageError(f"{what} {twice[0]} is there twice")


def _check_tracks(points: list[PointEntry], images: dict[int, ImageEntry]) -> None:
    """Every observation of a point is a keypoint of an image that is there."""
    if not points:
        return
    track = np.concatenate([point.track for point in points])
    if not len(track):
        return
    lengths = [len(point.track) for point in points]
    owner = np.repeat(np.arange(len(points)), lengths)
    ids, place = np.unique(track[:, 0], return_inverse=True)
    known = np.array([len(images[i].xy) if i in images else -1 for i in ids.tolist()])
    bad = np.flatnonzero(track[:, 1] >= known[place])
    if len(bad):
        image_id, keypoint = track[bad[0]]
        point_id = points[owner[bad[0]]].point_id
        raise DamageError(
            f"point {point_id} is seen as keypoint {keypoint} of image {image_id}, "
            "which is not there"
        )
