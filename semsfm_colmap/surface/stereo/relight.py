"""The reference as it would look in its neighbours' light.

Windows are correlated as if a surface kept its greys. It does not: with the law of `shading`, image
j sees a place of the normal n (in the camera's frame of the reference i) brighter than i does by

    exp(l_j . n),    l_j = R_ij^T d - d,    R_ij = R_j R_i^T,

so that on relief within a window the pattern itself changes with the tilt: walls of pits light up
one after the other, and what is matched stands out of the surface. The greys of the reference,
times that factor, are what j should show. d comes from the greys of the reconstructed points, with
their normals; those of the pixels from the local planes of the depth map. These lie too flat, since
they are fitted over a window, so that their relief is multiplied by a gain; on a smooth surface
they are mostly noise, which would be painted into the windows, so that the gain must be none. What
tells is whether the neighbours do show the change of light (`gain_of_relief`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semsfm_colmap.geometry.normals import estimate_normals, mean_viewing_direction
from semsfm_colmap.geometry.subset import new_numbers, spread_over
from semsfm_colmap.surface.shading import fit_shading
from semsfm_colmap.surface.stereo.level import Level
from semsfm_colmap.surface.stereo.rasters import Raster
from semsfm_colmap.types import Array, Bool, Float, Int, Reconstruction

MAX_GAIN = 1.5
"""Changes of the normal over those that the planes of the depth maps show. Rendered fields come out
better up to 2, grains are indifferent from 1 to 2."""
GAIN_OVER_SHOWN = 5.0
"""The gain over the share of the change that the neighbours show: the depths have already taken up
most of it by giving way. Rendered fields and grains show 0.15 to 0.8, smooth shapes below 0.03."""
_SAMPLING_PX = 4
_WINDOW_PX = 22
"""Changes over longer ways than this do not count for the gain."""
_OUTLIER = 3.0
"""Ratios of greys farther out than this, in standard deviations, are of occluded places."""
_MIN_TRACK_LENGTH = 3
_MAX_POINTS = 10_000
_MAX_IMAGES = 48
_NUM_NEIGHBORS = 12
"""Neighbours of the plane that gives a point its normal; 8 and 24 give the same law."""
_MIN_POINTS = 100
"""Of fewer points no law is taken."""


def light_of(reconstruction: Reconstruction, reader: Callable[[int], Raster]) -> Float:
    """The gradient d (3,) of a series' shading from its points; zero where there are too few.

    Parameters
    ----------
    reader : from image index to raster

    """
    import cv2

    cameras = reconstruction.cameras
    length = reconstruction.track_length()
    points = np.flatnonzero(length >= _MIN_TRACK_LENGTH)
    if len(points) < _MIN_POINTS:
        return np.zeros(3)
    X = np.asarray(reconstruction.points)[points]
    directions = mean_viewing_direction(reconstruction)[points]
    normals = estimate_normals(X, directions, _NUM_NEIGHBORS)
    # even subsets: the planes above want all the points
    some = spread_over(len(points), _MAX_POINTS)
    images = spread_over(reconstruction.num_images, _MAX_IMAGES)
    row = new_numbers(images, reconstruction.num_images)
    column = new_numbers(points[some], len(reconstruction.points))
    used = reconstruction.observations.select(reconstruction.inlier)
    i, k = row[used.image_idx], column[used.track_idx]
    i, k = i[(i >= 0) & (k >= 0)], k[(i >= 0) & (k >= 0)]

    R = np.asarray(cameras.cam_from_world)[images]
    normals_cam = np.einsum("mij,vj->mvi", R, normals[some])
    weight = np.zeros((len(images), len(some)), dtype=np.float32)
    weight[i, k] = np.maximum(-normals_cam[i, k, 2], 0.0)
    grey = np.zeros_like(weight)
    for m, image in enumerate(images.tolist()):
        raster = reader(image)
        scaling = np.array(raster.grey.shape[::-1]) / reconstruction.image_size_px[image]
        seen = np.full(len(some), image)
        xy = (cameras.project(X[some], seen) * scaling - 0.5).astype(np.float32)
        grey[m] = cv2.remap(raster.grey, xy[:, None], None, cv2.INTER_LINEAR)[:, 0]
    return fit_shading(grey, weight, normals_cam).gradient


def change_of_light(light: Float, cam_from_world: Float, reference: int, neighbors: Int) -> Float:
    """The vectors l_j (V, 3) of some neighbours, by the gradient d (3,) of the shading."""
    turn = cam_from_world[neighbors] @ cam_from_world[reference].T
    return np.asarray(np.einsum("vij,i->vj", turn, light) - light)


def gain_of_relief(level: Level, plane: Array, normals: Array, change: Float) -> float:
    """What the changes of the normals from pixel to pixel are multiplied by.

    With r_j the logarithm of what neighbour j shows over what the reference does and
    ``p_j = l_j . n`` what the normals predict, both less their means over a window, the share that
    is shown is the slope of the regression ``sum r_j p_j / sum p_j^2``: noise of the normals makes
    p_j large without any r_j.

    Parameters
    ----------
    level : the reference and its neighbours
    plane : (3, H, W) from `plane_kernels.local_planes`
    normals : (3, H, W) toward the viewer in the camera's frame, of those planes
    change : (V, 3) `change_of_light`

    """
    import cv2

    if not change.any():  # a series without a law
        return 0.0
    height, width = level.grey.shape
    some = np.s_[::_SAMPLING_PX, ::_SAMPLING_PX]
    v, u = (np.mgrid[:height, :width] + np.float32(0.5))[:, *some]
    own = np.log(np.maximum(level.grey[some] + level.mean_grey, 1.0))
    depth, normals = plane[0][some], np.ascontiguousarray(normals[:, *some])
    size = (_WINDOW_PX // _SAMPLING_PX, _WINDOW_PX // _SAMPLING_PX)

    def without_mean(values: Array, known: Bool) -> Array:
        count = np.maximum(cv2.blur(known.astype(np.float32), size), np.float32(1e-6))
        values = np.where(known, values, np.float32(0.0)).astype(np.float32)
        return np.asarray(values - cv2.blur(values, size) / count)[known]

    shown = power = 0.0
    for j, view in enumerate(level.views):
        B, c, e = level.sweep.B[j], level.sweep.c[j], level.sweep.e[j]
        x, y = (B[k, 0] * u + B[k, 1] * v + c[k] * depth + e[k] - 0.5 for k in range(2))
        seen = cv2.remap(
            view,
            np.nan_to_num(x, nan=-1e4).astype(np.float32),
            np.nan_to_num(y, nan=-1e4).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=float("nan"),
        )
        predicted = _products(change[j], normals)
        known = np.isfinite(seen) & np.isfinite(predicted)
        if not known.any():
            continue
        ratio = np.log(np.maximum(seen + level.mean_grey, 1.0)) - own
        r, p = without_mean(ratio, known), without_mean(predicted, known)
        kept = np.abs(r) <= _OUTLIER * r.std()
        shown += float(r[kept] @ p[kept])
        power += float(p[kept] @ p[kept])
    return float(np.clip(GAIN_OVER_SHOWN * shown / max(power, 1e-12), 0.0, MAX_GAIN))


def relit(grey: Array, normals: Array, change: Float, gain: float) -> Array:
    """The reference in each neighbour's light: (V, H, W) float32.

    Parameters
    ----------
    grey : (H, W) float32, as the detector gave it
    normals : (3, H, W) toward the viewer in the camera's frame; nan where unknown: unchanged there
    change : (V, 3) `change_of_light`
    gain : `gain_of_relief`

    """
    gained = np.float32(gain) * np.nan_to_num(normals)
    lit = np.empty((len(change), *grey.shape), dtype=np.float32)
    for change_j, lit_j in zip(change, lit, strict=True):
        np.exp(_products(change_j, gained), out=lit_j)
        lit_j *= grey
    return lit


def _products(vector: Float, normals: Array) -> Array:
    """Scalar products (H, W) of a vector (3,) with normals (3, H, W), float32.

    Three sums over contiguous rows: as a matrix product its short inner dimension costs more.
    """
    x, y, z = vector.astype(np.float32)
    result = x * normals[0]
    result += y * normals[1]
    result += z * normals[2]
    return np.asarray(result)
