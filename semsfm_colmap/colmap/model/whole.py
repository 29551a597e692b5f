"""Are the files of a binary COLMAP model as long as their own counts say?

pycolmap believes the counts: it takes gigabytes, or never comes back, where a file is cut short.
"""

from __future__ import annotations

import struct
from pathlib import Path

POINT_BYTES = 8 + 3 * 8 + 3 + 8
"""id, place, colour, error; then the length of the track."""
ELEMENT_BYTES = 4 + 4
"""image and keypoint of a track's element."""
IMAGE_BYTES = 4 + 4 * 8 + 3 * 8 + 4
"""id, rotation, translation, camera; then the name, a zero, and the number of keypoints."""
KEYPOINT_BYTES = 2 * 8 + 8
CAMERA_BYTES = 4 + 4 + 8 + 8 + 3 * 8
"""id, kind, width, height, and at least three parameters."""
COUNT = struct.Struct("<Q")


def is_whole(folder: Path) -> bool:
    """Whether points3D.bin and images.bin end where they say, and cameras.bin can."""
    try:
        points = (folder / "points3D.bin").read_bytes()
        images = (folder / "images.bin").read_bytes()
        cameras = (folder / "cameras.bin").read_bytes()
        if len(cameras) < COUNT.size + CAMERA_BYTES * max(COUNT.unpack_from(cameras)[0], 1):
            return False
        return _points_end(points) == len(points) and _images_end(images) == len(images)
    except (OSError, struct.error, ValueError):
        return False


def _points_end(data: bytes) -> int:
    place = COUNT.size
    for _ in range(COUNT.unpack_from(data)[0]):
        place += POINT_BYTES
        place += COUNT.size + ELEMENT_BYTES * COUNT.unpack_from(data, place)[0]
    return place


def _images_end(data: bytes) -> int:
    place = COUNT.size
    for _ in range(COUNT.unpack_from(data)[0]):
        place = data.index(b"\0", place + IMAGE_BYTES) + 1
        place += COUNT.size + KEYPOINT_BYTES * COUNT.unpack_from(data, place)[0]
    return place
