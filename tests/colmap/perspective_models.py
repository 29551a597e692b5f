"""A ball seen by perspective cameras of any of COLMAP's models, as COLMAP's mapper leaves it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.types import Array, Float

RADIUS = 1.5
DISTANCE = 6.0
SIZE = (320, 240)
EXTRA = {
    "SIMPLE_RADIAL": [0.02],
    "RADIAL": [0.02, -0.01],
    "OPENCV": [0.02, -0.01, 1e-3, 1e-3],
    "OPENCV_FISHEYE": [0.02, -0.01, 0.0, 0.0],
    "FULL_OPENCV": [0.02, -0.01, 1e-3, 1e-3, 0.0, 0.0, 0.0, 0.0],
}


def look_at(centre: Float) -> Float:
    """The camera at a place that looks at the origin: (3, 4)."""
    z = -centre / np.linalg.norm(centre)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    return np.column_stack([R, -R @ centre])


def around(num: int, spread_deg: float = 360.0) -> list[Float]:
    """Cameras on a ring of some height around the ball."""
    angles = np.radians(np.arange(num) * spread_deg / num)
    height = 1.5 * np.sin(3 * angles)
    flat = np.sqrt(DISTANCE**2 - height**2)
    return [
        look_at(np.array([f * np.sin(a), h, -f * np.cos(a)]))
        for a, h, f in zip(angles, height, flat, strict=True)
    ]


def ball(num: int, seed: int = 0) -> Float:
    """Random points on the ball."""
    v = np.random.default_rng(seed).normal(size=(num, 3))
    return np.asarray(RADIUS * v / np.linalg.norm(v, axis=1, keepdims=True))


def perspective_model(
    points: Float,
    poses: list[Float],
    *,
    camera_model: str = "PINHOLE",
    focal_px: float = 300.0,
    normals: Float | None = None,
    colors: Array | None = None,
    names: list[str] | None = None,
) -> Any:
    """A pycolmap.Reconstruction; a point is seen by the cameras on the side of its normal.

    Parameters
    ----------
    points : (N, 3)
    normals : (N, 3); default: away from the origin

    """
    normals = points / np.linalg.norm(points, axis=1, keepdims=True) if normals is None else normals
    camera = pycolmap.Camera.create_from_model_name(1, camera_model, focal_px, *SIZE)
    camera.params = [
        *camera.params[: len(camera.params) - len(EXTRA.get(camera_model, []))],
        *EXTRA.get(camera_model, []),
    ]
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    seen = []
    for i, pose in enumerate(poses):
        x = points @ pose[:, :3].T + pose[:, 3]
        toward = np.einsum(
            "ni,ni->n", normals, x @ pose[:, :3] / np.linalg.norm(x, axis=1)[:, None]
        )
        rows = np.flatnonzero((toward < -0.1) & (x[:, 2] > 0))
        xy = np.array(camera.img_from_cam(x[rows]), dtype=np.float64).reshape(-1, 2)
        good = np.isfinite(xy).all(axis=1)
        rows, xy = rows[good], xy[good]
        name = f"view_{i:02d}.png" if names is None else names[i]
        image = pycolmap.Image(name=name, keypoints=xy, camera_id=1, image_id=i + 1)
        model.add_image_with_trivial_frame(
            image, pycolmap.Rigid3d(pycolmap.Rotation3d(pose[:, :3].copy()), pose[:, 3].copy())
        )
        seen.append({int(row): k for k, row in enumerate(rows)})
    for j in range(len(points)):
        track = pycolmap.Track()
        for i, index in enumerate(seen):
            if j in index:
                track.add_element(i + 1, index[j])
        if track.length() >= 2:
            color = np.full(3, 90, np.uint8) if colors is None else colors[j]
            model.add_point3D(points[j], track, color)
    return model


def write_model(model: Any, folder: Path, *, text: bool = False) -> Path:
    """Write a model into a folder that is made."""
    folder.mkdir(parents=True, exist_ok=True)
    if text:
        model.write_text(str(folder))
    else:
        model.write_binary(str(folder))
    return folder


def ball_depth(pose: Float, matrix: Float, shape: tuple[int, int]) -> Array:
    """Depth of the ball at COLMAP's pixels (row, col) = image point (col, row), 0 beside it."""
    col, row = np.meshgrid(np.arange(shape[1], dtype=float), np.arange(shape[0], dtype=float))
    ray = np.stack([col, row, np.ones(shape)], axis=-1) @ np.linalg.inv(matrix).T
    centre = pose[:, 3]  # of the ball, in the camera's frame
    a, b = (ray**2).sum(-1), ray @ centre
    root = b**2 - a * (centre @ centre - RADIUS**2)
    depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0.0))) / a, 0.0)
    return depth.astype(np.float32)
