"""COLMAP's sparse model: written from a `Reconstruction`, checked, and read back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.database.work import DatabaseImage
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.build import build_model
from semsfm_colmap.colmap.model.contents import Contents, all_finite
from semsfm_colmap.colmap.model.points_ply import FILE_NAME as POINTS_FILE_NAME
from semsfm_colmap.colmap.model.points_ply import covariance_of, read_points_ply, write_points_ply
from semsfm_colmap.colmap.model.rows import open_with_contents
from semsfm_colmap.colmap.model.sidecar import (
    FILE_NAME,
    cameras_from_sidecar,
    depth_sign_from_sidecar,
    drift_from_sidecar,
    read_sidecar,
    sidecar_dict,
)
from semsfm_colmap.colmap.model.telecentric import (
    PinholeCameras,
    pinhole_cameras,
    project_pinhole,
    required_focal_length,
)
from semsfm_colmap.colmap.options import ExportOptions
from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.io.atomic import folder_aside
from semsfm_colmap.types import Float, Observations, Reconstruction


@dataclass(frozen=True, kw_only=True)
class WrittenModel:
    """What was written, and how far it is from parallel projection."""

    path: Path
    focal_length_px: float
    max_deviation_px: float
    mean_reprojection_error_px: float


def model_deviation(model: Any, reconstruction: Reconstruction) -> float:
    """Largest distance, over all inlier observations, between COLMAP's camera and ours.

    Computed from the poses, the camera and the points as pycolmap holds them.
    """
    by_name = {image.name: image for image in model.images.values()}
    R, T, f, c = [], [], [], []
    for name in reconstruction.image_names:
        image = by_name[name]
        pose = np.asarray(image.cam_from_world().matrix())
        camera = model.cameras[image.camera_id]
        R.append(pose[:, :3])
        T.append(pose[:, 3])
        f.append((camera.focal_length_x, camera.focal_length_y))
        c.append((camera.principal_point_x, camera.principal_point_y))
    obs = reconstruction.observations.select(reconstruction.inlier)
    X = reconstruction.points[obs.track_idx]
    i = obs.image_idx
    pinhole = project_pinhole(np.array(R)[i], np.array(T)[i], np.array(f)[i], np.array(c)[i], X)
    ours = reconstruction.cameras.project(X, i)
    return float(np.max(np.linalg.norm(pinhole - ours, axis=1), initial=0.0))


def write_model(
    reconstruction: Reconstruction,
    path: Path,
    database_images: Mapping[str, DatabaseImage],
    keypoints: Mapping[str, Float],
    options: ExportOptions,
    *,
    reliability: Mapping[str, Any] | None = None,
) -> WrittenModel:
    """Write the binary model, orthographic.json and points.ply into `path`, aside, then renamed.

    The deviation from parallel projection is measured on what was written; a model that misses the
    bound is an error, not a file. COLMAP has no camera with skew: there the deviation that is left
    is only stated.
    """
    obs = reconstruction.observations.select(reconstruction.inlier)
    principal = reconstruction.image_size_px / 2.0
    focal = required_focal_length(
        reconstruction.cameras,
        reconstruction.points[obs.track_idx],
        obs.image_idx,
        principal,
        reconstruction.image_size_px,
        options.max_deviation_px,
    )
    names = reconstruction.image_names
    model = build_model(
        reconstruction,
        pinhole_cameras(reconstruction.cameras, reconstruction.image_size_px, focal),
        names,
        [database_images[name].image_id for name in names],
        [keypoints[name] for name in names],
    )
    with folder_aside(path) as aside:
        model.write_binary(str(aside))
        deviation = model_deviation(pycolmap.Reconstruction(str(aside)), reconstruction)
        if reconstruction.cameras.skew == 0.0 and deviation > 1.01 * options.max_deviation_px:
            raise InputError(
                f"the pinhole camera with f = {focal:.3g} px deviates by {deviation:.3g} px, more "
                f"than the bound of {options.max_deviation_px} px: raise --export.max_deviation_px"
            )
        data = sidecar_dict(reconstruction, focal, deviation, reliability)
        (aside / FILE_NAME).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        write_points_ply(reconstruction, aside / POINTS_FILE_NAME)
    return WrittenModel(
        path=path,
        focal_length_px=focal,
        max_deviation_px=deviation,
        mean_reprojection_error_px=float(model.compute_mean_reprojection_error()),
    )


def write_perspective_model(
    reconstruction: Reconstruction,
    view: Perspective,
    path: Path,
    database_images: Mapping[str, DatabaseImage],
    keypoints: Mapping[str, Float],
) -> None:
    """Write what a series with perspective is to COLMAP: pinholes of focal length 1 / kappa > 0.

    Parameters
    ----------
    view : what was taken out of the observations
    keypoints : (K, 2) px of each image, as they were measured

    """
    cameras, names = reconstruction.cameras, reconstruction.image_names
    focal = np.array([1.0, cameras.aspect]) / view.kappa
    pinholes = PinholeCameras(
        focal_px=np.tile(focal, (len(names), 1)),
        principal_point_px=view.principal_px,
        cam_from_world=np.asarray(cameras.cam_from_world),
        translation=view.pinhole_translations(cameras),
    )
    model = build_model(
        reconstruction,
        pinholes,
        names,
        [database_images[name].image_id for name in names],
        [keypoints[name] for name in names],
    )
    with folder_aside(path) as aside:
        model.write_binary(str(aside))


def read_model(path: Path | str) -> Reconstruction:
    """Read what `write_model` wrote: cameras from the sidecar, the rest from COLMAP's files.

    The inliers of the model are its observations; what the mapping rejected is not in it.

    Parameters
    ----------
    path : a folder such as PROJECT/sparse/0

    Returns
    -------
    cameras, points and observations; image i of the result is the i-th name of orthographic.json

    Raises
    ------
    InputError
        There is no model, or its files do not belong together.

    Examples
    --------
    >>> model = read_model("project/sparse/0")
    >>> model.num_images, model.world_unit, model.points.shape[1]
    (11, 'um', 3)
    >>> residuals = model.residuals()[model.inlier]  # (O, 2) px
    >>> bool(np.sqrt(np.mean(residuals**2)) < 0.2)
    True

    """
    path = Path(path)
    if not (path / "points3D.bin").is_file() and not (path / "points3D.txt").is_file():
        raise InputError(f"{path} holds no COLMAP model: run `semsfm map` first")
    data = read_sidecar(path / FILE_NAME)
    model, contents = open_with_contents(path)
    images = sorted(model.images.values(), key=lambda image: image.image_id)
    order = {name: k for k, name in enumerate(data["images"])}
    missing = [image.name for image in images if image.name not in order]
    if missing:
        raise InputError(
            f"{path / FILE_NAME} does not know the image {missing[0]}: the model was changed by "
            "another program; run `semsfm map` again"
        )
    images.sort(key=lambda image: order[image.name])
    names = tuple(image.name for image in images)
    point_ids = sorted(model.points3D)
    stored = [model.points3D[point_id] for point_id in point_ids]
    points = np.array([point.xyz for point in stored]).reshape(-1, 3)
    if not all_finite(points):
        raise InputError(
            f"{path} has a point at a place that is not finite: run `semsfm map` again"
        )
    observations = _observations(contents, point_ids, [image.image_id for image in images])
    sizes = np.array(
        [(model.cameras[i.camera_id].width, model.cameras[i.camera_id].height) for i in images]
    )
    reconstruction = Reconstruction(
        image_names=names,
        image_size_px=sizes,
        cameras=cameras_from_sidecar(data, names),
        points=points,
        observations=observations,
        inlier=np.ones(len(observations), dtype=bool),
        point_color=np.array([point.color for point in stored], dtype=np.uint8).reshape(-1, 3),
        world_unit=data["world_unit"],
        pixel_size_um=(data["pixel_size"] or {}).get("value"),
        pixel_size_source=(data["pixel_size"] or {}).get("source", "none"),
        camera_model=data["camera_model"],
        depth_sign=depth_sign_from_sidecar(data),
        gauge=data["gauge"],
        drift_px=drift_from_sidecar(data, names),
        drag_px=data.get("reliability", {}).get("drag", {}).get("coefficient_px"),
        relief_px=data.get("reliability", {}).get("relief_px"),
    )
    entries = [data["images"][name] for name in names]
    if all("sigma_rotation_deg" in e for e in entries) and entries:
        reconstruction = replace(
            reconstruction,
            sigma_rotation_rad=np.deg2rad([e["sigma_rotation_deg"] for e in entries]),
            sigma_translation_px=np.array([e["sigma_translation_px"] for e in entries]),
            sigma_scale=np.array([e.get("sigma_scale_relative", np.nan) for e in entries]),
        )
    covariance = stored_covariance(path / POINTS_FILE_NAME, reconstruction.points)
    return replace(reconstruction, point_covariance=covariance)


def _observations(contents: Contents, point_ids: list[int], image_ids: list[int]) -> Observations:
    """The tracks of the points in the order of `point_ids`, by image in that of `image_ids`."""
    tracks = {point.point_id: point.track for point in contents.points}
    lengths = [len(tracks[point_id]) for point_id in point_ids]
    elements = np.concatenate(
        [np.zeros((0, 2), np.uint32), *(tracks[point_id] for point_id in point_ids)]
    )
    by_id = np.argsort(image_ids)
    image_idx = by_id[np.searchsorted(np.array(image_ids)[by_id], elements[:, 0])]
    track_idx = np.repeat(np.arange(len(point_ids)), lengths)
    rows = np.lexsort((image_idx, track_idx))
    track_idx, image_idx = track_idx[rows], image_idx[rows]
    keypoint_idx = elements[rows, 1].astype(np.int64)
    keypoints = {image.image_id: image.xy for image in contents.images}
    first = np.cumsum([0, *(len(keypoints[i]) for i in image_ids)])
    xy = np.concatenate([np.zeros((0, 2)), *(keypoints[i] for i in image_ids)])
    return Observations(
        track_idx=track_idx,
        image_idx=image_idx,
        keypoint_idx=keypoint_idx,
        xy=xy[first[image_idx] + keypoint_idx],
        num_images=len(image_ids),
        num_tracks=len(point_ids),
    )


def stored_covariance(path: Path, points: Float) -> Float | None:
    """The points' covariances of points.ply, if it is there and of these very points."""
    if not path.is_file():
        return None
    rows = read_points_ply(path)
    if len(rows) != len(points) or not np.array_equal(
        np.stack([rows[k] for k in "xyz"], 1), points
    ):
        return None
    covariance = covariance_of(rows)
    return None if np.isnan(covariance).all() else covariance
