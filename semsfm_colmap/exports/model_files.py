"""COLMAP models with the pinholes of `pinhole.py`, built in memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.exports.pinhole import PinholeViews
from semsfm_colmap.exports.scene import ExportScene


def build_pinhole_model(scene: ExportScene, views: PinholeViews, camera_model: str) -> Any:
    """A pycolmap.Reconstruction; images of one size and focal length share a camera.

    Parameters
    ----------
    scene : image ids and keypoints are kept; inlier observations become tracks
    views : the cameras
    camera_model : SIMPLE_PINHOLE (square pixels) or PINHOLE

    """
    reconstruction = scene.reconstruction
    model = pycolmap.Reconstruction()
    known: dict[tuple[float, ...], int] = {}
    for i, name in enumerate(scene.names):
        width, height = (int(v) for v in reconstruction.image_size_px[i])
        fx, fy = (float(v) for v in views.focal_px[i])
        cx, cy = (float(v) for v in views.principal_point_px[i])
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
            keypoints=np.array(scene.keypoints[i], dtype=np.float64),
            camera_id=known[key],
            image_id=scene.image_ids[i],
        )
        rotation = pycolmap.Rotation3d(np.array(views.cam_from_world[i]))
        pose = pycolmap.Rigid3d(rotation, np.array(views.translation[i]))
        model.add_image_with_trivial_frame(image, pose)
    _add_points(model, scene)
    model.update_point_3d_errors()
    return model


def _add_points(model: Any, scene: ExportScene) -> None:
    reconstruction = scene.reconstruction
    obs = reconstruction.observations.select(reconstruction.inlier)
    bounds = np.searchsorted(obs.track_idx, np.arange(len(reconstruction.points) + 1))
    image_id = np.array(scene.image_ids)
    colors = reconstruction.point_color
    grey = np.full(3, 128, dtype=np.uint8)
    for j in range(len(reconstruction.points)):
        rows = slice(bounds[j], bounds[j + 1])
        track = pycolmap.Track()
        for i, k in zip(obs.image_idx[rows], obs.keypoint_idx[rows], strict=True):
            track.add_element(int(image_id[i]), int(k))
        color = grey if colors is None else np.array(colors[j])
        model.add_point3D(np.array(reconstruction.points[j]), track, color)


def camera_model_for(scene: ExportScene) -> str:
    """SIMPLE_PINHOLE for square pixels, else PINHOLE."""
    return "SIMPLE_PINHOLE" if scene.reconstruction.cameras.aspect == 1.0 else "PINHOLE"
