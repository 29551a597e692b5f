"""Any sparse model with long-focal cameras as orthographic ones, with the deviation stated.

A pinhole far from the specimen is parallel to ``|x - c| |s z| / f``. Its orthographic stand-in has
the magnification at the depth D of a reference point p, by default the points' centroid,
``s = f / D``, and the image of p in the same place:

    R = R_pinhole,   s = f_x / D,   t = xy(p) - s K2 (R p)[:2]

with K2 = diag(1, f_y / f_x).

Nothing is fitted: the distance between the model's own projections (its camera model, distortion
included) and those of the stand-in, over all observations, is measured and returned.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.model.contents import MAX_NUMBER
from semsfm_colmap.colmap.model.rows import (
    ModelRow,
    is_perspective,
    open_model,
    registered,
    rows_of,
)
from semsfm_colmap.errors import InputError
from semsfm_colmap.types import (
    Array,
    Float,
    Int,
    Observations,
    OrthographicCameras,
    Reconstruction,
)

MAX_DEVIATION_PX = 1.0
"""Beyond this a model is not that of a parallel projection."""
ASPECT_TOLERANCE = 1e-6
"""Relative difference of f_y / f_x that still counts as one aspect."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeReading:
    """A sparse model as orthographic cameras, and what it said itself."""

    reconstruction: Reconstruction
    max_deviation_px: float
    """Largest distance between the model's projections and ours, over all observations"""
    mean_reprojection_error_px: float
    """Of the model's own cameras"""
    rows: dict[str, ModelRow]
    focal_length_px: Float
    """(M, 2) along x and y"""
    camera_models: tuple[str, ...]
    """The kinds of cameras in it"""


def read_pinhole_model(
    path: Path | str,
    *,
    max_deviation_px: float = MAX_DEVIATION_PX,
    reference: Float | None = None,
) -> PinholeReading:
    """Read a sparse model that has no orthographic.json.

    The world is the file's; ``world_unit`` is "px", as nothing says more, and the hand is left
    open.

    Parameters
    ----------
    path : COLMAP model folder, binary or text
    max_deviation_px : how far from parallel projection its cameras may be
    reference : (3,) point whose depth gives the magnifications; default: the points' centroid

    Returns
    -------
    the model as orthographic cameras, with the deviation that was measured

    Raises
    ------
    InputError
        There is no model, fewer than three points, or its cameras are not parallel to
        `max_deviation_px`.

    Examples
    --------
    >>> reading = read_pinhole_model("project/sparse/0")
    >>> reading.reconstruction.num_images
    11
    >>> bool(reading.max_deviation_px < 0.02)
    True

    """
    path = Path(path)
    model = open_model(path)
    images = registered(model)
    if len(model.points3D) < 3 or not images:
        raise InputError(
            f"{path} has {len(images)} registered images and {len(model.points3D)} points: nothing "
            "to read cameras from"
        )
    rows = rows_of(model)
    names = tuple(image.name for image in images)
    points, colors, observations = _points(model, images, rows)
    far = int((~(np.abs(points) < MAX_NUMBER)).any(axis=1).sum())
    if far:
        raise InputError(
            f"{path} has {far} points at places that are not finite: filter them out with the "
            "program that made it"
        )
    cameras, focal = _cameras(
        path, model, images, rows, points.mean(axis=0) if reference is None else reference
    )
    reconstruction = Reconstruction(
        image_names=names,
        image_size_px=np.array(
            [
                (model.cameras[image.camera_id].width, model.cameras[image.camera_id].height)
                for image in images
            ],
            dtype=np.int64,
        ),
        cameras=cameras,
        points=points,
        observations=observations,
        inlier=np.ones(len(observations), dtype=bool),
        point_color=colors,
        gauge="as in the COLMAP model",
    )
    projected = _projections(model, images, rows, points, observations)
    ours = cameras.project(points[observations.track_idx], observations.image_idx)
    deviation = float(np.max(np.linalg.norm(projected - ours, axis=1), initial=0.0))
    if not deviation <= max_deviation_px:
        raise InputError(
            f"{path} is not a model of parallel projection: orthographic cameras in place of its "
            f"own move observations by up to {deviation:.3g} px, more than {max_deviation_px:g} px "
            f"(focal length {float(np.median(focal[:, 0])):.3g} px)"
        )
    error = np.linalg.norm(projected - observations.xy, axis=1)
    return PinholeReading(
        reconstruction=reconstruction,
        max_deviation_px=deviation,
        mean_reprojection_error_px=float(np.mean(error)) if len(error) else 0.0,
        rows=rows,
        focal_length_px=focal,
        camera_models=tuple(
            sorted({model.cameras[image.camera_id].model_name for image in images})
        ),
    )


def _points(
    model: Any, images: list[Any], rows: dict[str, ModelRow]
) -> tuple[Float, Array, Observations]:
    number = {image.image_id: i for i, image in enumerate(images)}
    keypoints = [rows[image.name].keypoints for image in images]
    table: list[tuple[int, int, int]] = []
    points, colors = [], []
    for j, point_id in enumerate(sorted(model.points3D)):
        point = model.points3D[point_id]
        points.append(point.xyz)
        colors.append(point.color)
        # a track may hold one image twice; the first observation counts
        seen: dict[int, int] = {}
        for element in point.track.elements:
            seen.setdefault(number[element.image_id], int(element.point2D_idx))
        table += [(j, i, seen[i]) for i in sorted(seen)]
    indices: Int = np.array(table, dtype=np.int64).reshape(-1, 3)
    observations = Observations(
        track_idx=indices[:, 0],
        image_idx=indices[:, 1],
        keypoint_idx=indices[:, 2],
        xy=np.array([keypoints[i][k] for _, i, k in table], dtype=np.float64).reshape(-1, 2),
        num_images=len(images),
        num_tracks=len(points),
    )
    return (
        np.array(points, dtype=np.float64).reshape(-1, 3),
        np.array(colors, dtype=np.uint8).reshape(-1, 3),
        observations,
    )


def _cameras(
    path: Path, model: Any, images: list[Any], rows: dict[str, ModelRow], reference: Float
) -> tuple[OrthographicCameras, Float]:
    R, s, t, focal = [], [], [], []
    for image in images:
        camera = model.cameras[image.camera_id]
        if not is_perspective(camera):
            raise InputError(
                f"{path} is not a model of parallel projection: {image.name} has the camera model "
                f"{camera.model_name}"
            )
        pose = rows[image.name].cam_from_world
        x = pose[:, :3] @ reference + pose[:, 3]
        fx, fy = float(camera.focal_length_x), float(camera.focal_length_y)
        if not min(fx, fy) > 1.0 / MAX_NUMBER:
            raise InputError(f"{path}: the camera of {image.name} has no positive focal length")
        if not x[2] > 1.0 / MAX_NUMBER:
            raise InputError(f"{path}: the points lie behind the camera of {image.name}")
        scale = fx / x[2]
        xy = np.array([camera.principal_point_x, camera.principal_point_y]) + (
            np.array([fx, fy]) * x[:2] / x[2]
        )
        R.append(pose[:, :3])
        s.append(scale)
        t.append(xy - scale * np.array([1.0, fy / fx]) * (pose[:2, :3] @ reference))
        focal.append((fx, fy))
    focal_px = np.array(focal)
    aspect = focal_px[:, 1] / focal_px[:, 0]
    if np.ptp(aspect) > ASPECT_TOLERANCE * aspect[0]:
        raise InputError(
            f"{path} has cameras of different aspect ({aspect.min():.6g} to {aspect.max():.6g}), "
            "but one is shared by all images of an orthographic model"
        )
    exact = 1.0 if abs(aspect[0] - 1.0) < 1e-12 else float(aspect.mean())
    cameras = OrthographicCameras(
        cam_from_world=np.array(R),
        scale_px_per_unit=np.array(s),
        translation_px=np.array(t),
        aspect=exact,
    )
    return cameras, focal_px


def _projections(
    model: Any,
    images: list[Any],
    rows: dict[str, ModelRow],
    points: Float,
    observations: Observations,
) -> Float:
    """Where the model's own cameras see the points: (O, 2)."""
    result = np.full((len(observations), 2), np.nan)
    for i, image in enumerate(images):
        mine = np.flatnonzero(observations.image_idx == i)
        pose = rows[image.name].cam_from_world
        x = points[observations.track_idx[mine]] @ pose[:, :3].T + pose[:, 3]
        if len(mine):
            result[mine] = np.asarray(model.cameras[image.camera_id].img_from_cam(x))
    return result
