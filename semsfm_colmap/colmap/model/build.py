"""COLMAP models of a reconstruction seen by pinholes, built in memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.telecentric import PinholeCameras
from semsfm_colmap.types import Float, Reconstruction

GREY = 128
"""Of points whose colour is not known."""


def build_model(
    reconstruction: Reconstruction,
    cameras: PinholeCameras,
    names: Sequence[str],
    image_ids: Sequence[int],
    keypoints: Sequence[Float],
    camera_model: str | None = None,
) -> Any:
    """A pycolmap.Reconstruction; images of one size and focal length share a camera.

    Parameters
    ----------
    reconstruction : its inlier observations become tracks
    cameras : the pinholes in place of its own cameras
    names, image_ids, keypoints : of its images in the model; keypoints (K, 2) px, all of them
    camera_model : SIMPLE_PINHOLE, PINHOLE; None takes the first for square pixels

    """
    if camera_model is None:
        square = reconstruction.cameras.aspect == 1.0
        camera_model = "SIMPLE_PINHOLE" if square else "PINHOLE"
    model = pycolmap.Reconstruction()
    known: dict[tuple[float, ...], int] = {}
    for i, name in enumerate(names):
        width, height = (int(v) for v in reconstruction.image_size_px[i])
        fx, fy = (float(v) for v in cameras.focal_px[i])
        cx, cy = (float(v) for v in cameras.principal_point_px[i])
        params = [fx, cx, cy] if camera_model == "SIMPLE_PINHOLE" else [fx, fy, cx, cy]
        key = (width, height, *params)
        if key not in known:
            known[key] = len(known) + 1
            camera = pycolmap.Camera(
                model=camera_model,
                width=width,
                height=height,
                params=params,
                camera_id=known[key],
            )
            model.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(
            name=name,
            keypoints=np.array(keypoints[i], dtype=np.float64),
            camera_id=known[key],
            image_id=image_ids[i],
        )
        rotation = pycolmap.Rotation3d(np.array(cameras.cam_from_world[i]))
        pose = pycolmap.Rigid3d(rotation, np.array(cameras.translation[i]))
        model.add_image_with_trivial_frame(image, pose)
    _add_points(model, reconstruction, image_ids)
    model.update_point_3d_errors()
    return model


def _add_points(model: Any, reconstruction: Reconstruction, image_ids: Sequence[int]) -> None:
    obs = reconstruction.observations.select(reconstruction.inlier)
    bounds = np.searchsorted(obs.track_idx, np.arange(len(reconstruction.points) + 1))
    colors = reconstruction.point_color
    grey = np.full(3, GREY, dtype=np.uint8)
    for j in range(len(reconstruction.points)):
        rows = slice(bounds[j], bounds[j + 1])
        track = pycolmap.Track()
        for i, k in zip(obs.image_idx[rows], obs.keypoint_idx[rows], strict=True):
            track.add_element(int(image_ids[i]), int(k))
        color = grey if colors is None else np.array(colors[j])
        model.add_point3D(np.array(reconstruction.points[j]), track, color)


def quaternion_wxyz(rotation: Float) -> Float:
    """A rotation (3, 3) as the quaternion that COLMAP's files hold, real part first: (4,)."""
    x, y, z, w = pycolmap.Rotation3d(np.array(rotation)).quat
    return np.array([w, x, y, z])
