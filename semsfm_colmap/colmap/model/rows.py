"""Image ids, keypoints and cameras of a sparse model as COLMAP's files hold them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.errors import InputError
from semsfm_colmap.types import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelRow:
    """One registered image."""

    image_id: int
    camera_id: int
    keypoints: Float
    """(K, 2) px"""
    cam_from_world: Float
    """(3, 4)"""


def open_model(path: Path) -> Any:
    """A pycolmap.Reconstruction; one sentence when the folder holds none."""
    if not any((path / f"points3D.{end}").is_file() for end in ("bin", "txt")):
        raise InputError(f"{path} holds no COLMAP model: give the folder with points3D.bin or .txt")
    try:
        model = pycolmap.Reconstruction(str(path))
    except (ValueError, RuntimeError, IndexError) as error:
        text = " ".join(str(error).split())[:160]
        raise InputError(f"{path} cannot be read as a COLMAP model ({text})") from error
    names = [image.name for image in model.images.values()]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path} holds the image {twice} twice: remove one of them")
    return model


def registered(model: Any) -> list[Any]:
    """The images that have a pose, by id."""
    images = [image for image in model.images.values() if image.has_pose]
    return sorted(images, key=lambda image: image.image_id)


def rows_of(model: Any) -> dict[str, ModelRow]:
    """The registered images of an open model, by name."""
    return {
        image.name: ModelRow(
            image_id=int(image.image_id),
            camera_id=int(image.camera_id),
            keypoints=np.array([p.xy for p in image.points2D], dtype=np.float64).reshape(-1, 2),
            cam_from_world=np.array(image.cam_from_world().matrix(), dtype=np.float64),
        )
        for image in registered(model)
    }


def model_rows(path: Path) -> dict[str, ModelRow]:
    """The registered images of a model on disk, by name."""
    return rows_of(open_model(path))
