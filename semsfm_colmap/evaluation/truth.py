"""The truth of a synthetic series: true cameras, angles and surface, read from its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.npz import UNREADABLE
from semsfm_colmap.types import Float, OrthographicCameras, TriangleMesh

ROTATION_TOLERANCE = 1e-6
"""Largest |R R^T - I| of a rotation in a truth file: decimals survive, other matrices do not."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What is known exactly about a rendered series; lengths in scene units."""

    path: Path
    names: tuple[str, ...]
    """Image names in order"""
    cameras: OrthographicCameras
    image_size_px: tuple[int, int]
    """Width and height of the image area, without databar"""
    unit_um: float
    """Micrometres per scene unit"""
    true_deg: Float
    """(M,) angle of each image about the axis of the turn"""
    axis: Float
    """(3,) that axis in the frame of the camera at angle 0"""
    mesh: TriangleMesh | None
    """The surface, where the folder has it"""

    @property
    def scale_px_per_unit(self) -> float:
        """Mean scale: turns lengths of the scene into px."""
        return float(self.cameras.scale_px_per_unit.mean())

    @property
    def pixel_size_um(self) -> float:
        """Mean size of a pixel."""
        return self.unit_um / self.scale_px_per_unit


def load_truth(path: Path | str) -> Truth:
    """Read the truth of a synthetic series.

    Parameters
    ----------
    path : folder with `truth.json` and, for the surface, `mesh.npz`; or that `truth.json`

    Returns
    -------
    names, cameras and, where they are there, the mesh and the angles of the series

    Raises
    ------
    InputError
        When there is no truth, or it cannot be understood: which file, and what is wrong.

    Examples
    --------
    >>> truth = load_truth(Path("field"))  # what `synthesize` wrote
    >>> truth.names
    ('field_000.png', 'field_001.png', 'field_002.png')
    >>> truth.cameras.cam_from_world.shape
    (3, 3, 3)

    """
    path = Path(path)
    file = path / "truth.json" if path.is_dir() else path
    if not file.is_file():
        raise InputError(
            f"{path} holds no truth.json: give the folder that `semsfm synthesize` wrote."
        )
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        truth = _parsed(content, file)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not JSON ({error}): write the series again.") from error
    except KeyError as error:
        raise InputError(f"{file} lacks {error}: it is not the truth of a series.") from error
    except (TypeError, ValueError, IndexError) as error:
        raise InputError(f"{file} cannot be understood ({error}).") from error
    return truth


def _parsed(content: dict[str, Any], file: Path) -> Truth:
    frames = content["frames"]
    names = tuple(str(frame["name"]) for frame in frames)
    stems = [Path(name).stem for name in names]
    if not names or len(set(stems)) != len(stems):
        raise InputError(f"{file} lists no images, or one of them twice.")
    R = np.array([frame["R"] for frame in frames], dtype=np.float64).reshape(-1, 3, 3)
    off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max()
    if not off <= ROTATION_TOLERANCE or np.linalg.det(R).min() < 0:
        raise InputError(f"{file} holds matrices R that are not rotations.")
    scale = np.array([frame["scale"] for frame in frames], dtype=np.float64)
    unit_um = float(content["unit_um"])
    if not (np.all(scale > 0) and unit_um > 0):
        raise InputError(f"{file} holds a scale or unit_um that is not positive.")
    K2 = np.array(content["K2"], dtype=np.float64)
    x0, y0, x1, y1 = content["image_area"]
    translation = np.array([frame["t"] for frame in frames], dtype=np.float64).reshape(-1, 2)
    return Truth(
        path=file.parent,
        names=names,
        cameras=OrthographicCameras(
            cam_from_world=R,
            scale_px_per_unit=scale * K2[0, 0],
            translation_px=translation - [x0, y0],
            aspect=float(K2[1, 1] / K2[0, 0]),
            skew=float(K2[0, 1] / K2[0, 0]),
        ),
        image_size_px=(int(x1 - x0), int(y1 - y0)),
        unit_um=unit_um,
        true_deg=np.array([frame["true_deg"] for frame in frames], dtype=np.float64),
        axis=np.array(content["rotation_axis_cam"], dtype=np.float64),
        mesh=_mesh(file.parent / "mesh.npz"),
    )


def _mesh(file: Path) -> TriangleMesh | None:
    if not file.is_file():
        return None
    try:
        with file.open("rb") as opened, np.load(opened) as stored:
            vertices = stored["vertices"].astype(np.float64)
            faces = stored["faces"].astype(np.int64)
    except UNREADABLE as error:
        raise InputError(f"{file} is not a surface with vertices and faces ({error}).") from error
    if vertices.ndim != 2 or faces.ndim != 2 or not len(faces) or faces.max() >= len(vertices):
        raise InputError(f"{file} holds faces {faces.shape} that do not fit {vertices.shape=}.")
    return TriangleMesh(vertices=vertices, faces=faces)
