"""Depth maps in space: their unit, their points, their planes and normals."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.types import Array, DepthMap, Float, Int, OrthographicCameras

_PLANE_STEP_PX = 2.5
"""Neighbouring depths that differ by more do not belong to one plane."""


def depth_map_unit(
    cameras: OrthographicCameras, image_idx: int, image_size: Array, depth_map: DepthMap
) -> float:
    """World units per pixel of a depth map."""
    scaling = np.mean(np.array(depth_map.depth.shape[::-1]) / np.asarray(image_size))
    return float(1.0 / (cameras.scale_px_per_unit[image_idx] * scaling))


def camera_normals(
    cameras: OrthographicCameras, image_idx: int, scaling: Float, plane: Array
) -> Array:
    """Unit normals toward the viewer, in the camera frame, from slopes: (3, H, W) float32.

    The slopes ``dz/dp`` per pixel of the depth map become ``dz/dx_cam = (S s K2)^T dz/dp`` with the
    scaling S; the normal is ``(dz/dx, dz/dy, -1)``.
    """
    to_px = scaling[:, None] * cameras.scale_px_per_unit[image_idx] * cameras.K2
    (a, b), (c, d) = to_px.astype(np.float32)
    normal = np.empty(plane.shape, dtype=np.float32)
    normal[0] = a * plane[1] + c * plane[2]
    normal[1] = b * plane[1] + d * plane[2]
    normal[2] = -1.0
    normal /= np.sqrt(normal[0] ** 2 + normal[1] ** 2 + 1.0)
    return normal


def planes_and_normals(
    cameras: OrthographicCameras,
    image_idx: int,
    image_size: Array,
    depth_map: DepthMap,
    radius_px: int,
) -> tuple[Array, Array]:
    """The local planes of a depth map and their normals, toward the viewer in the camera frame.

    Parameters
    ----------
    image_idx, image_size : the image of the map, and its width and height
    radius_px : depths within this distance have a say, by their confidence

    Returns
    -------
    planes : (3, H, W) depth and its change along x and y per px of the map
    normals : (3, H, W) float32

    """
    confidence = depth_map.confidence
    if confidence is None:
        confidence = np.isfinite(depth_map.depth).astype(np.float32)
    unit = depth_map_unit(cameras, image_idx, image_size, depth_map)
    planes = local_planes(depth_map.depth, confidence, radius_px, _PLANE_STEP_PX * unit)
    scaling = np.array(depth_map.depth.shape[::-1]) / image_size
    return planes, camera_normals(cameras, image_idx, scaling, planes)


def back_project(
    cameras: OrthographicCameras, image_idx: int, scaling: Float, x: Int, y: Int, depth: Float
) -> Float:
    """World points of depth-map pixels: (n,), (n,), (n,) -> (n, 3)."""
    xy = np.column_stack([x, y]) + 0.5
    centred = xy / scaling - cameras.translation_px[image_idx]
    flat = centred @ np.linalg.inv(cameras.K2).T / cameras.scale_px_per_unit[image_idx]
    return np.asarray(np.column_stack([flat, depth]) @ cameras.cam_from_world[image_idx])
