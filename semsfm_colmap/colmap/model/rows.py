"""Image ids, keypoints and cameras of a sparse model as COLMAP's files hold them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.binary_contents import read_binary_contents
from semsfm_colmap.colmap.model.contents import CLASSIC, Contents, check_contents
from semsfm_colmap.colmap.model.text_contents import read_text_contents
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
    """A pycolmap.Reconstruction; one sentence when the folder holds none, or a damaged one."""
    return open_with_contents(path)[0]


def open_with_contents(path: Path) -> tuple[Any, Contents]:
    """A pycolmap.Reconstruction, and keypoints and tracks as arrays.

    Nothing is handed to pycolmap before its counts and references are known to be possible.
    """
    end = model_files(path)
    try:
        contents = read_binary_contents(path) if end == "bin" else read_text_contents(path)
    except OSError as error:
        place = error.filename or path
        raise InputError(f"{place} cannot be read ({error.strerror})") from error
    check_contents(contents, path, end)
    names = [image.name for image in contents.images]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path} holds the image {twice!r} twice: remove one of them")
    try:
        model = pycolmap.Reconstruction(str(path))
    except (ValueError, RuntimeError, IndexError) as error:
        text = " ".join(str(error).split())[:160]
        raise InputError(f"{path} cannot be read as a COLMAP model ({text})") from error
    for image in contents.images:
        model.images[image.image_id].name = image.name  # its reader of text cuts them at a space
    return model, contents


def model_files(path: Path) -> str:
    """The ending of a model's files, bin before txt; InputError when one is missing."""
    missing = {
        end: [name for name in CLASSIC if not (path / f"{name}.{end}").is_file()]
        for end in ("bin", "txt")
    }
    for end, names in missing.items():
        if not names:
            return end
    for end, names in missing.items():
        if "points3D" not in names:
            raise InputError(
                f"{path} has points3D.{end} but no {names[0]}.{end}: copy it there from where the "
                "model was made"
            )
    raise InputError(f"{path} holds no COLMAP model: give the folder with points3D.bin or .txt")


def is_perspective(camera: Any) -> bool:
    """Whether its rays meet in the image plane: pycolmap 4.0 knows no camera of another kind."""
    return bool(getattr(camera, "is_perspective", lambda: True)())


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
