"""COLMAP's .txt files read as its .bin files are: numbers where numbers belong, and all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.model.contents import (
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
from semsfm_colmap.types import Float

MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE",
    "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE",
    "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip
"""COLMAP's camera models, by their number."""
CAMERA_SENSOR = "CAMERA"
POSE_LENGTH = 7


def read_text_contents(path: Path) -> Contents:
    """Read the .txt files of a model; InputError with the line that cannot be one."""
    return gather(
        path,
        "txt",
        _read,
        cameras=_cameras,
        images=_images,
        points=_points,
        rigs=_rigs,
        frames=_frames,
    )


class Lines:
    """The lines of a file that say something, as words; it knows where it is."""

    def __init__(self, text: str) -> None:
        self._rows = text.split("\n")
        self.number = 0

    def __iter__(self) -> Iterator[list[str]]:
        return self

    def __next__(self) -> list[str]:
        while self.number < len(self._rows):
            words = self.following()
            if words and not words[0].startswith("#"):
                return words
        raise StopIteration

    def following(self) -> list[str]:
        """The next line, whatever it is."""
        self.number += 1
        return self._rows[self.number - 1].split() if self.number <= len(self._rows) else []


def _read(path: Path, parse: Callable[[Lines], None]) -> None:
    try:
        lines = Lines(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise damaged(path, DamageError("it is not a text in UTF-8")) from error
    try:
        parse(lines)
    except (DamageError, ValueError, IndexError, OverflowError) as error:
        what = str(error) if isinstance(error, DamageError) else "a number is missing or is none"
        raise damaged(path, DamageError(f"line {lines.number}: {what}")) from error


def _cameras(lines: Lines) -> list[int]:
    ids = []
    for words in lines:
        if words[1] not in MODELS:
            raise DamageError(f"the camera model {words[1]!r} is none of COLMAP's")
        parameters = _floats(words[4:])
        if len(parameters) != PARAMETERS[MODELS.index(words[1])]:
            raise DamageError(f"{words[1]} has {len(parameters)} parameters")
        check_camera(_index(words[0]), (_index(words[2]), _index(words[3])), parameters)
        ids.append(_index(words[0]))
    return ids


def _images(lines: Lines) -> list[ImageEntry]:
    images = []
    for words in lines:
        pose = _floats(words[1:8])
        name = " ".join(words[9:])
        if not name:
            raise DamageError("the image has no name")
        check_pose(pose, f"the image {name!r}")
        rest = lines.following()
        if len(rest) % 3:
            raise DamageError("keypoints are x, y and the number of a point")
        xy = np.stack([_floats(rest[0::3]), _floats(rest[1::3])], axis=1)
        point_id = np.array([_index(w) if w != "-1" else 2**64 - 1 for w in rest[2::3]], np.uint64)
        images.append(
            ImageEntry(
                image_id=_index(words[0]),
                camera_id=_index(words[8]),
                name=name,
                pose=pose,
                xy=xy,
                point_id=point_id,
            )
        )
    return images


def _points(lines: Lines) -> list[PointEntry]:
    points = []
    for words in lines:
        if len(_floats(words[1:4])) < 3 or len(words) < 8 or len(words) % 2:
            raise DamageError("a point is its number, x, y, z, r, g, b, error and who sees it")
        if not np.isfinite(_floats(words[1:4])).all():
            raise DamageError("the point lies at no finite place; take its line out")
        if not all(0 <= _index(w) <= 255 for w in words[4:7]):
            raise DamageError("a colour is beyond 255")
        float(words[7])
        track = np.array([_index(w) for w in words[8:]], dtype=np.uint32).reshape(-1, 2)
        points.append(PointEntry(point_id=_index(words[0]), track=track))
    return points


def _rigs(lines: Lines, rigs: dict[int, list[int]]) -> None:
    for words in lines:
        rig_id, number, rest = _index(words[0]), _index(words[1]), words[2:]
        if rig_id in rigs:
            raise DamageError(f"rig {rig_id} is there twice")
        rigs[rig_id] = []
        for k in range(number):
            if rest[0] == CAMERA_SENSOR:
                rigs[rig_id].append(_index(rest[1]))
            has_pose = k > 0 and _index(rest[2])
            if has_pose:
                check_pose(_floats(rest[3 : 3 + POSE_LENGTH]), f"rig {rig_id}")
            rest = rest[2 + (k > 0) + (POSE_LENGTH if has_pose else 0) :]


def _frames(lines: Lines, frames: dict[int, int], images: list[int]) -> None:
    for words in lines:
        frame_id, number = _index(words[0]), _index(words[2 + POSE_LENGTH])
        if frame_id in frames:
            raise DamageError(f"frame {frame_id} is there twice")
        check_pose(_floats(words[2 : 2 + POSE_LENGTH]), f"frame {frame_id}")
        frames[frame_id] = _index(words[1])
        data = words[3 + POSE_LENGTH :]
        if len(data) != 3 * number:
            raise DamageError(f"{number} images are announced")
        images += [
            _index(data_id)
            for kind, data_id in zip(data[0::3], data[2::3], strict=True)
            if kind == CAMERA_SENSOR
        ]


def _index(word: str) -> int:
    number = int(word)
    if not 0 <= number < 2**64:
        raise ValueError(word)
    return number


def _floats(words: list[str]) -> Float:
    return np.array([float(word) for word in words], dtype=np.float64)
