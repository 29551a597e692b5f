"""The reference as it would look in its neighbours' light.

Windows are correlated as if a surface kept its greys. It does not: with the law of `shading`, image
j sees a place of the normal n (in the camera's frame of the reference i) brighter than i does by

    exp(l_j . n),    l_j = R_ij^T d - d,    R_ij = R_j R_i^T,

so that on relief within a window the pattern itself changes with the tilt: walls of pits light up
one after the other, and what is matched stands out of the surface. The greys of the reference,
times that factor, are what j should show. d comes from the greys of the reconstructed points, with
their normals; those of the pixels from the local planes of the depth map, which lie too flat, since
they are fitted over a window: `RELIEF_GAIN`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semsfm_colmap.geometry.normals import estimate_normals, mean_viewing_direction
from semsfm_colmap.geometry.subset import new_numbers, spread_over
from semsfm_colmap.surface.shading import fit_shading
from semsfm_colmap.surface.stereo.rasters import Raster
from semsfm_colmap.types import Array, Float, Int, Reconstruction

RELIEF_GAIN = 1.5
"""Changes of the normal over those that the planes of the depth maps show. Rendered fields come out
better up to 2, grains are indifferent from 1 to 2."""
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


def relit(grey: Array, normals: Array, change: Float) -> Array:
    """The reference in each neighbour's light: (V, H, W) float32.

    Parameters
    ----------
    grey : (H, W) float32, as the detector gave it
    normals : (3, H, W) toward the viewer in the camera's frame; nan where unknown: unchanged there
    change : (V, 3) `change_of_light`

    """
    gained = np.float32(RELIEF_GAIN) * np.nan_to_num(normals)
    factor = np.exp(np.tensordot(change.astype(np.float32), gained, axes=1))
    return np.asarray(grey * factor, dtype=np.float32)
