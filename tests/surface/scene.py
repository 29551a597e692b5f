"""A textured ball and a textured plane seen by orthographic cameras, in closed form."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import (
    Array,
    DepthMap,
    Float,
    Observations,
    OrthographicCameras,
    Reconstruction,
)

WIDTH, HEIGHT = 160, 120
SCALE = 20.0
RADIUS = 2.2


def turning_cameras(
    angles_deg: Float | list[float], *, aspect: float = 1.0, skew: float = 0.0
) -> OrthographicCameras:
    """Cameras that turn about the world's y axis; at 0 they look along +z."""
    angles = np.radians(np.asarray(angles_deg, dtype=float))
    axis = np.array([0.0, 1.0, 0.0])
    num = len(angles)
    return OrthographicCameras(
        cam_from_world=rotation_from_vector(angles[:, None] * axis),
        scale_px_per_unit=np.full(num, SCALE),
        translation_px=np.tile([WIDTH / 2.0, HEIGHT / 2.0], (num, 1)),
        aspect=aspect,
        skew=skew,
    )


def pixel_rays(cameras: OrthographicCameras, i: int) -> tuple[Float, Float]:
    """For each pixel the world point at depth 0 (H, W, 3) and the direction (3,)."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    xy = np.stack([u, v], axis=-1) - cameras.translation_px[i]
    flat = xy @ np.linalg.inv(cameras.K2).T / cameras.scale_px_per_unit[i]
    R = cameras.cam_from_world[i]
    return flat @ R[:2], R[2]


def ball_depth(cameras: OrthographicCameras, i: int, radius: float = RADIUS) -> Float:
    """Depth of the visible side of a ball around the origin, nan beside it: (H, W)."""
    start, direction = pixel_rays(cameras, i)
    across2 = (start**2).sum(axis=-1) - (start @ direction) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(-np.sqrt(radius**2 - across2))


def plane_depth(cameras: OrthographicCameras, i: int, normal: Float) -> Float:
    """Depth of the plane ``normal . X = 0``: (H, W)."""
    start, direction = pixel_rays(cameras, i)
    return np.asarray(-(start @ normal) / (direction @ normal))


def solid_texture(points: Float, seed: int = 0) -> Float:
    """A smooth random function of space, mean 0, deviation about 1, wavelengths of 5 to 12 px."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(40, 3))
    waves *= (
        2
        * np.pi
        / (rng.uniform(5.0, 12.0, (40, 1)) / SCALE)
        / np.linalg.norm(waves, axis=1, keepdims=True)
    )
    phase = rng.uniform(0, 2 * np.pi, 40)
    return np.asarray(np.sin(points @ waves.T + phase).sum(axis=-1) / np.sqrt(20.0))


def picture(cameras: OrthographicCameras, i: int, depth: Float, noise: float, seed: int) -> Array:
    """8-bit image of a surface given by its depth; black where that is nan."""
    start, direction = pixel_rays(cameras, i)
    seen = np.isfinite(depth)
    points = start + np.where(seen, depth, 0.0)[..., None] * direction
    grey = np.where(seen, 130.0 + 35.0 * solid_texture(points), 12.0)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.6)
    grey += np.random.default_rng([seed, i]).normal(0.0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def write_pictures(
    folder: Path, cameras: OrthographicCameras, depths: list[Float], noise: float = 2.0
) -> tuple[str, ...]:
    """Write one picture per camera; returns the names."""
    folder.mkdir(parents=True, exist_ok=True)
    names = tuple(f"view_{i:02d}.png" for i in range(len(cameras)))
    for i, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), picture(cameras, i, depths[i], noise, 5))
    return names


def reconstruction_of(
    cameras: OrthographicCameras,
    names: tuple[str, ...],
    points: Float,
    visible: Array | None = None,
    **attributes: Array,
) -> Reconstruction:
    """A reconstruction with exact observations; `visible` (M, N) says who sees what."""
    if visible is None:
        visible = np.ones((len(cameras), len(points)), dtype=bool)
    track, image = np.nonzero(visible.T)
    observations = Observations(
        image_idx=image,
        track_idx=track,
        keypoint_idx=np.arange(len(track)),
        xy=cameras.project(points[track], image),
        num_images=len(cameras),
        num_tracks=len(points),
    )
    return Reconstruction(
        image_names=names,
        image_size_px=np.tile([WIDTH, HEIGHT], (len(cameras), 1)),
        cameras=cameras,
        points=points,
        observations=observations,
        inlier=np.ones(len(track), dtype=bool),
        **attributes,
    )


def ball_points(num: int, seed: int = 1, radius: float = RADIUS) -> Float:
    """Random points on the ball: (num, 3)."""
    v = np.random.default_rng(seed).normal(size=(num, 3))
    return np.asarray(radius * v / np.linalg.norm(v, axis=1, keepdims=True))


def ball_reconstruction(
    cameras: OrthographicCameras, names: tuple[str, ...], num_points: int = 1500
) -> Reconstruction:
    """Points on the ball, seen where they face the camera."""
    points = ball_points(num_points)
    visible = cameras.viewing_direction @ points.T < -0.3 * RADIUS
    seen = visible.sum(axis=0) >= 2
    return reconstruction_of(cameras, names, points[seen], visible[:, seen])


def ball_depth_maps(cameras: OrthographicCameras, names: tuple[str, ...]) -> list[DepthMap]:
    """The true depth maps of the ball."""
    return [
        DepthMap(
            image_name=name,
            depth=ball_depth(cameras, i).astype(np.float32),
            confidence=np.isfinite(ball_depth(cameras, i)).astype(np.float32),
        )
        for i, name in enumerate(names)
    ]
