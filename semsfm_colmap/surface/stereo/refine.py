"""Sharpen a depth map: Gauss-Newton on windows that lie on its surface.

Each step begins from the local planes at all pixels: they keep from the depths what is finer than
the windows, which no step would take back.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.depth_geometry import camera_normals
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.level import Level
from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.surface.stereo.refine_kernels import surface_step
from semsfm_colmap.surface.stereo.relight import gain_of_relief, relit
from semsfm_colmap.types import Array, Float, Int, OrthographicCameras


def refine_depths(
    level: Level,
    cameras: OrthographicCameras,
    reference: int,
    change_of_light: Float,
    depth: Array,
    score: Array,
    options: SurfaceOptions,
) -> tuple[Array, Array, Array]:
    """Gauss-Newton on windows that lie on the surface.

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
    slopes = _epipolar_gradient(level)
    information = np.zeros_like(depth)
    for _ in range(options.num_refinements):
        plane = local_planes(depth, score, options.slope_radius_px, 2.5 * level.unit)
        normals = camera_normals(cameras, reference, level.scaling, plane)
        gain = gain_of_relief(level, plane, normals, change_of_light)
        lit = relit(level.grey + level.mean_grey, normals, change_of_light, gain)
        lit -= np.float32(level.mean_grey)
        surface_step(
            level.grey,
            lit,
            plane[0],
            level.views,
            slopes,
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
            depth,
            score,
            information,
        )
    with np.errstate(divide="ignore"):
        return depth, score, 1.0 / np.sqrt(information)


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
    """Change of each neighbour's grey with depth, ``grad I . c``: (V, H, W) float32."""
    import cv2

    out = np.empty_like(level.views)
    for j, view in enumerate(level.views):
        dx = cv2.Scharr(view, cv2.CV_32F, 1, 0) / 32.0
        dy = cv2.Scharr(view, cv2.CV_32F, 0, 1) / 32.0
        out[j] = level.sweep.c[j, 0] * dx + level.sweep.c[j, 1] * dy
    return out
