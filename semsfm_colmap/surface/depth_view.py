"""One depth map and where its pixels lie in space, for parallel and perspective cameras alike.

A pixel of the map at (u, v), the first one with its centre at (0.5, 0.5), and a depth z belong to

    (u w, v w, w) = P (X, 1),    z = d . (X, 1),

with P (3, 4) and d (4,). Under parallel projection the last row of P is (0, 0, 0, 1), so that
w = 1; for a pinhole it is d itself, w = z.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from semsfm_colmap.types import Array, Bool, DepthMap, Float, Int, OrthographicCameras


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthView:
    """A depth map with its camera."""

    depth: Array
    """(H, W) depth z, nan where unknown, world units"""
    projection: Float
    """P (3, 4), world to pixels of the map"""
    depth_row: Float
    """d (4,), world to depth"""
    normals: Array | None = None
    """(H, W, 3) unit normals toward the viewer, world frame"""
    colors: Array | None = None
    """(H, W, 3) uint8"""

    def project(self, points: Float) -> tuple[Float, Float, Float]:
        """Where points are seen, u and v in px, and their depth: (N, 3) -> (N,), (N,), (N,)."""
        x = points @ self.projection[:, :3].T + self.projection[:, 3]
        w = np.where(np.abs(x[:, 2]) > 0, x[:, 2], np.nan)
        z = points @ self.depth_row[:3] + self.depth_row[3]
        return x[:, 0] / w, x[:, 1] / w, z

    def depth_at(self, u: Float, v: Float) -> Float:
        """The map's depth at the nearest pixel, nan outside: (N,)."""
        height, width = self.depth.shape
        with np.errstate(invalid="ignore"):
            inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        out = np.full(len(u), np.nan)
        out[inside] = self.depth[v[inside].astype(np.int64), u[inside].astype(np.int64)]
        return out

    def pixels(self) -> tuple[Int, Int]:
        """Rows and columns of the pixels with a depth: (n,), (n,)."""
        row, col = np.nonzero(np.isfinite(self.depth))
        return row, col

    def points(self, row: Int, col: Int) -> Float:
        """World points of pixels: (n,), (n,) -> (n, 3).

        ``P_i . X - (u, v)_i P_3 . X = 0`` for i = 1, 2 and ``d . X = z`` are three linear
        equations in X.
        """
        uv = np.column_stack([col, row]) + 0.5
        z = self.depth[row, col].astype(np.float64)
        P, d = self.projection, self.depth_row
        lines = P[None, :2] - uv[:, :, None] * P[None, 2:]
        A = np.concatenate([lines[:, :, :3], np.broadcast_to(d[:3], (len(z), 1, 3))], axis=1)
        right = np.concatenate([-lines[:, :, 3], (z - d[3])[:, None]], axis=1)
        return np.linalg.solve(A, right[:, :, None])[:, :, 0]

    def rays(self, points: Float) -> Float:
        """Unit directions from the viewer to points: (N, 3) -> (N, 3)."""
        if not np.any(self.projection[2, :3]):
            axis = np.cross(self.projection[0, :3], self.projection[1, :3])
            axis *= np.sign(axis @ self.depth_row[:3]) / np.linalg.norm(axis)
            return np.broadcast_to(axis, points.shape)
        # both lines of a pixel hold the ray; their cross product is it, up to its sign
        u, v, _ = self.project(points)
        P = self.projection
        a = P[0, :3] - u[:, None] * P[2, :3]
        b = P[1, :3] - v[:, None] * P[2, :3]
        ray = np.cross(a, b)
        ray *= np.sign(ray @ self.depth_row[:3])[:, None]
        return np.asarray(ray / np.linalg.norm(ray, axis=1, keepdims=True))

    def pixel_size(self, points: Float) -> Float:
        """World units that a pixel covers at points: (N, 3) -> (N,)."""
        w = points @ self.projection[2, :3] + self.projection[2, 3]
        scale = np.sqrt(np.linalg.norm(np.cross(self.projection[0, :3], self.projection[1, :3])))
        if np.any(self.projection[2, :3] != 0):
            a = self.projection[:2, :3] - np.outer(self._centre_px(), self.projection[2, :3])
            scale = np.sqrt(np.linalg.norm(np.cross(a[0], a[1])))
        return np.asarray(np.abs(w) / scale)

    def _centre_px(self) -> Float:
        return np.array(self.depth.shape[::-1]) / 2.0


def parallel_view(
    cameras: OrthographicCameras, image_idx: int, image_size: Array, depth_map: DepthMap
) -> DepthView:
    """The view of an orthographic camera's depth map."""
    scaling = np.array(depth_map.depth.shape[::-1]) / np.asarray(image_size, dtype=np.float64)
    P = np.zeros((3, 4))
    P[:2, :3] = scaling[:, None] * cameras.projection[image_idx]
    P[:2, 3] = scaling * cameras.translation_px[image_idx]
    P[2, 3] = 1.0
    row = np.append(cameras.viewing_direction[image_idx], 0.0)
    return DepthView(depth=depth_map.depth, projection=P, depth_row=row)


def pinhole_view(
    depth: Array,
    matrix: Float,
    cam_from_world: Float,
    image_size: Array,
    *,
    normals: Array | None = None,
    colors: Array | None = None,
    max_size_px: int = 1024,
) -> DepthView:
    """The view of a depth map of COLMAP's patch-match stereo, reduced to every k-th pixel.

    Its pixel (row, col) is the image point (col, row), half a pixel beside the centre of a pixel
    as calibration matrices count them.

    Parameters
    ----------
    depth : (H, W) z along the camera's axis, 0 where unknown
    matrix : (3, 3) K of the image
    cam_from_world : (3, 4)
    image_size : width and height that K belongs to; the map may be smaller
    normals : (H, W, 3) in the camera frame, 0 where unknown
    colors : (H', W', 3) uint8 of the image
    max_size_px : longer side of the reduced map

    """
    height, width = depth.shape
    step = int(np.ceil(max(height, width) / max_size_px))
    K = np.array([width, height, 1.0])[:, None] / np.array([*image_size, 1.0])[:, None] * matrix
    shift = np.array([[1.0 / step, 0.0, 0.5], [0.0, 1.0 / step, 0.5], [0.0, 0.0, 1.0]])
    R = cam_from_world[:, :3]
    small = np.where(depth > 0, depth, np.nan)[::step, ::step].astype(np.float32)
    world = None
    if normals is not None and normals.shape[:2] == depth.shape:
        world = (normals[::step, ::step] @ R).astype(np.float16)
    if colors is not None:
        rows = np.arange(small.shape[0]) * step * colors.shape[0] // height
        cols = np.arange(small.shape[1]) * step * colors.shape[1] // width
        colors = colors[rows[:, None], cols]
    return DepthView(
        depth=small,
        projection=shift @ K @ cam_from_world,
        depth_row=np.array(cam_from_world[2]),
        normals=world,
        colors=colors,
    )


class LazyViews(Sequence[DepthView]):
    """Views that are made when they are asked for, so that few are in memory."""

    def __init__(self, make: Callable[[int], DepthView], num: int) -> None:
        self._make, self._num = make, num

    def __len__(self) -> int:
        return self._num

    @overload
    def __getitem__(self, index: int) -> DepthView: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[DepthView]: ...

    def __getitem__(self, index: int | slice) -> DepthView | Sequence[DepthView]:
        if isinstance(index, slice):
            return [self._make(i) for i in range(self._num)[index]]
        if not 0 <= index < self._num:
            raise IndexError(index)
        return self._make(index)


def seen_by(view: DepthView, points: Float, tolerance: Float) -> Bool:
    """Points within a tolerance of what a view saw at their place: (N,)."""
    u, v, z = view.project(points)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(view.depth_at(u, v) - z) <= tolerance)
