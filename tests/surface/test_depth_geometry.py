"""Depth maps in space, against planes in closed form."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.depth_geometry import (
    back_project,
    depth_map_unit,
    planes_and_normals,
)
from semsfm_colmap.types import DepthMap
from tests.surface.scene import HEIGHT, SCALE, WIDTH, plane_depth, turning_cameras


def test_pixels_go_back_to_where_they_came_from() -> None:
    cameras = turning_cameras([37.0], aspect=1.1, skew=0.03)
    points = np.random.default_rng(0).normal(size=(10, 3))
    scaling = np.array([0.5, 0.25])
    xy = cameras.project(points, np.zeros(10, dtype=np.int64)) * scaling
    depth = points @ cameras.viewing_direction[0]
    back = back_project(cameras, 0, scaling, xy[:, 0] - 0.5, xy[:, 1] - 0.5, depth)
    np.testing.assert_allclose(back, points, atol=1e-9)


def test_a_pixel_of_a_smaller_map_is_larger_in_the_world() -> None:
    cameras = turning_cameras([0.0])
    small = DepthMap(image_name="a", depth=np.zeros((HEIGHT // 2, WIDTH // 2), np.float32))
    unit = depth_map_unit(cameras, 0, np.array([WIDTH, HEIGHT]), small)
    np.testing.assert_allclose(unit, 2.0 / SCALE)


def test_a_plane_has_its_slopes_and_one_normal_toward_the_viewer() -> None:
    cameras = turning_cameras([20.0], aspect=1.1, skew=0.03)
    normal = np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0])
    depth = plane_depth(cameras, 0, normal)
    depth_map = DepthMap(image_name="a", depth=depth.astype(np.float32))
    planes, normals = planes_and_normals(cameras, 0, np.array([WIDTH, HEIGHT]), depth_map, 3)
    inner = np.s_[10:-10, 10:-10]
    slope = np.stack([np.gradient(depth, axis=1), np.gradient(depth, axis=0)])
    np.testing.assert_allclose(planes[0][inner], depth[inner], atol=0.01 / SCALE)
    # the fit of the slope gives up a few percent to be steady at edges
    np.testing.assert_allclose(planes[1:, *inner], slope[:, *inner], rtol=0.05, atol=1e-4)
    expected = cameras.cam_from_world[0] @ normal
    found = normals[:, *inner].reshape(3, -1)
    np.testing.assert_allclose(found, np.tile(expected[:, None], found.shape[1]), atol=0.02)
