"""Sharpen a depth map: Gauss-Newton on windows that lie in the local planes."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.depth_geometry import camera_normals
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.level import Level
from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.surface.stereo.refine_kernels import slanted_step
from semsfm_colmap.surface.stereo.relight import gain_of_relief, relit
from semsfm_colmap.types import Array, Float, Int, OrthographicCameras

_STRIDE_PX = 2
"""The steps move every second pixel, as on a chessboard. Their windows overlap by more than half,
so that the pixels between would say little of their own: they move as their neighbours do."""


def refine_depths(
    level: Level,
    cameras: OrthographicCameras,
    reference: int,
    change_of_light: Float,
    depth: Array,
    score: Array,
    options: SurfaceOptions,
) -> tuple[Array, Array, Array]:
    """Gauss-Newton on windows that lie in the local planes.

    Parameters
    ----------
    level : at the size of the depths
    cameras, reference : of the series, and the image of the depths
    change_of_light : (V, 3) to each neighbour, see `relight`
    depth, score : (H, W) float32, overwritten

    Returns
    -------
    depth, score, sigma : sharper depths, their correlations, and the standard deviation of each
        depth by its windows alone, ``1 / sqrt(information)``, in world units; inf where none counts

    """
    window, window_weight = _window(options.window_radius_px)
    gradient = _epipolar_gradient(level)
    information = np.zeros_like(depth)
    for _ in range(options.num_refinements):
        plane = local_planes(depth, score, options.slope_radius_px, 2.5 * level.unit)
        normals = camera_normals(cameras, reference, level.scaling, plane)
        gain = gain_of_relief(level, plane, normals, change_of_light)
        lit = relit(level.grey + level.mean_grey, normals, change_of_light, gain)
        slanted_step(
            level.grey,
            lit,
            plane,
            gradient,
            level.view_usable,
            level.sweep.B,
            level.sweep.c,
            level.sweep.e,
            window,
            window_weight,
            level.noise,
            options.window_grey_share * level.contrast,
            options.visibility_spread,
            options.smoothness / level.unit**2,
            _STRIDE_PX,
            depth,
            score,
            information,
        )
    _move_between(plane[0], depth, score, information)
    with np.errstate(divide="ignore"):
        return depth, score, 1.0 / np.sqrt(information)


def _move_between(before: Array, depth: Array, score: Array, information: Array) -> None:
    """Depth, correlation and information of the pixels between those that moved, in place.

    They move from the depth `before` of their local planes by the mean step of their four
    neighbours, whose correlation and information they take; nan with fewer than two.
    """
    import cv2

    y, x = np.ogrid[: depth.shape[0], : depth.shape[1]]
    between = (x + y) % _STRIDE_PX != 0
    moved = np.isfinite(depth) & ~between
    cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], dtype=np.float32)

    def around(values: Array) -> Array:
        kept = np.where(moved, values, np.float32(0.0))
        return cv2.filter2D(kept, -1, cross, borderType=cv2.BORDER_CONSTANT)[between]

    num = around(np.ones_like(depth))
    known = (num >= 2) & np.isfinite(before[between])
    num[~known] = 1.0
    depth[between] = np.where(known, before[between] + around(depth - before) / num, np.nan)
    score[between] = np.where(known, around(score) / num, 0.0)
    information[between] = np.where(known, around(information) / num, 0.0)


def _window(radius: int) -> tuple[Int, Array]:
    """Every sample near the centre, every second one farther out, with Gaussian weights.

    Two thirds of the samples go, next to none of the accuracy. Leaving out every second one near
    the centre too would tie a pixel only to its diagonal neighbours.
    """
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    taken = (np.maximum(abs(x), abs(y)) <= 1) | ((x % 2 == 0) & (y % 2 == 1))
    taken |= (x % 2 == 1) & (y % 2 == 0)
    offset = np.stack([x, y], axis=-1)[taken].astype(np.int64)
    distance2 = (offset**2).sum(axis=1)
    return offset, np.exp(-0.5 * distance2 / (0.8 * radius) ** 2).astype(np.float32)


def _epipolar_gradient(level: Level) -> Array:
    """Grey and its change with depth, ``grad I . c``, side by side: (V, H, W, 2) float32."""
    import cv2

    out = np.empty((*level.views.shape, 2), dtype=np.float32)
    for j, view in enumerate(level.views):
        out[j, ..., 0] = view
        dx = cv2.Scharr(view, cv2.CV_32F, 1, 0) / 32.0
        dy = cv2.Scharr(view, cv2.CV_32F, 0, 1) / 32.0
        out[j, ..., 1] = level.sweep.c[j, 0] * dx + level.sweep.c[j, 1] * dy
    return out
