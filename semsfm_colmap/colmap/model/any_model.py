"""Any COLMAP model, whoever made it, as plain arrays: points, who sees them, and the cameras.

All of COLMAP's camera models are read: points and visibility need only the poses. A camera without
distortion has a matrix K besides, which depth maps need.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.model.contents import all_finite
from semsfm_colmap.colmap.model.rows import is_perspective, open_model, registered
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.apart import ONE_FILE, DiedError, call_apart
from semsfm_colmap.types import Array, Float, Int


@dataclass(frozen=True, kw_only=True, eq=False)
class AnyModel:
    """M images and N points of a model."""

    path: Path
    image_names: tuple[str, ...]
    image_size_px: Int
    """(M, 2) width, height"""
    camera_models: tuple[str, ...]
    """COLMAP's name of each image's camera model"""
    cam_from_world: Float
    """(M, 3, 4)"""
    matrix: Float
    """(M, 3, 3) K, nan where the camera has distortion or no plane"""
    points: Float
    """(N, 3)"""
    colors: Array
    """(N, 3) uint8"""
    observation_point: Int
    """(O,) which point"""
    observation_image: Int
    """(O,) is seen by which image; once each"""
    observation_keypoint: Int
    """(O,) as which of the image's keypoints"""

    @property
    def num_images(self) -> int:
        """Registered images."""
        return len(self.image_names)

    @property
    def centres(self) -> Float:
        """Camera centres in the world: (M, 3)."""
        R, t = self.cam_from_world[:, :, :3], self.cam_from_world[:, :, 3]
        return np.asarray(-np.einsum("mji,mj->mi", R, t))

    def track_length(self) -> Int:
        """Images that see each point: (N,)."""
        return np.bincount(self.observation_point, minlength=len(self.points))


def read_any_model(path: Path, image_path: Path | None = None) -> AnyModel:
    """Read a model, binary or text.

    Parameters
    ----------
    path : folder with points3D.bin or .txt
    image_path : images from which points take their colours when the model has none

    Raises
    ------
    InputError
        There is no model, or it cannot be read.

    """
    model = open_model(path)
    images = registered(model)
    if image_path is not None and len(model.points3D) and not _has_colors(model):
        found = _found_colors(path, image_path)
    else:
        found = {i: point.color for i, point in model.points3D.items()}
    number = {image.image_id: i for i, image in enumerate(images)}
    points: list[Float] = []
    colors: list[Array] = []
    table: list[tuple[int, int, int]] = []
    for point_id in sorted(model.points3D):
        point = model.points3D[point_id]
        if not all_finite(point.xyz):
            continue
        # a track may hold one image twice; the first observation counts
        seen: dict[int, int] = {}
        for element in point.track.elements:
            if element.image_id in number:
                seen.setdefault(number[element.image_id], int(element.point2D_idx))
        table += [(len(points), i, seen[i]) for i in sorted(seen)]
        points.append(point.xyz)
        colors.append(found[point_id])
    cameras = [model.cameras[image.camera_id] for image in images]
    observed: Int = np.array(table, dtype=np.int64).reshape(-1, 3)
    return AnyModel(
        path=path,
        image_names=tuple(image.name for image in images),
        image_size_px=np.array([(c.width, c.height) for c in cameras], dtype=np.int64).reshape(
            -1, 2
        ),
        camera_models=tuple(camera.model_name for camera in cameras),
        cam_from_world=np.array(
            [image.cam_from_world().matrix() for image in images], dtype=np.float64
        ).reshape(-1, 3, 4),
        matrix=np.array([_matrix(camera) for camera in cameras]).reshape(-1, 3, 3),
        points=np.array(points, dtype=np.float64).reshape(-1, 3),
        colors=np.array(colors, dtype=np.uint8).reshape(-1, 3),
        observation_point=observed[:, 0],
        observation_image=observed[:, 1],
        observation_keypoint=observed[:, 2],
    )


def model_size(path: Path) -> tuple[int, int]:
    """Registered images and points of a model: what components are compared by."""
    model = open_model(path)
    return len(registered(model)), len(model.points3D)


def image_names(path: Path) -> set[str]:
    """Names of the registered images of a model."""
    return {image.name for image in registered(open_model(path))}


def holds_model(path: Path) -> bool:
    """Whether a folder holds a model, binary or text."""
    return any((path / f"points3D.{end}").is_file() for end in ("bin", "txt"))


def point_colors(path: Path, image_path: Path) -> dict[int, Array]:
    """Colours of the points of a model by their ids, from the images that see them."""
    model = open_model(path)
    # COLMAP warns of images that are missing, and leaves their points as they were
    model.extract_colors_for_all_images(str(image_path))
    return {i: np.asarray(point.color) for i, point in model.points3D.items()}


def _found_colors(path: Path, image_path: Path) -> dict[int, Array]:
    """The same in a process that may die of an image of others."""
    try:
        return call_apart(ONE_FILE, point_colors, path.absolute(), image_path.absolute())
    except DiedError as died:
        raise InputError(
            f"an image below {image_path} ended the process that took colours from it ({died}): "
            "write the images again, or leave the folder out"
        ) from died


def _has_colors(model: Any) -> bool:
    return any(np.any(point.color) for point in model.points3D.values())


def _matrix(camera: Any) -> Float:
    if not (is_perspective(camera) and camera.is_undistorted()):
        return np.full((3, 3), np.nan)
    return np.asarray(camera.calibration_matrix(), dtype=np.float64)
