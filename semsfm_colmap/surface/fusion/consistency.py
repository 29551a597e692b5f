"""Do several depth maps agree? Each pixel of one is looked up in the others.

The maps between images are affine (`views.py`), so a look-up is a few multiplications. Agreement is
measured across the surface, not along a ray: delta = (depth difference) x cos(angle to the normal),
so that a slanted view is not held to a depth accuracy that it cannot have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.surface.depth_geometry import depth_map_unit
from semsfm_colmap.surface.fusion.vote_kernels import add_votes
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.views import affine_sweep
from semsfm_colmap.types import Array, DepthMap, Float, Int, OrthographicCameras


@dataclass(frozen=True, kw_only=True, eq=False)
class Votes:
    """What the other maps say about each pixel of one depth map."""

    agreeing: Array
    """(H, W) uint8"""
    contradicting: Array
    """(H, W) uint8"""
    weight: Array
    """(H, W) float32, sum over the agreeing maps"""
    offset: Array
    """(H, W) float32, their mean distance outward along the normal, world units"""
    spread: Array
    """(H, W) float32, the deviation of these distances, world units"""
    best_cosine: Array
    """(H, W) float32, the largest cosine between the normal and an agreeing map's direction"""


def vote(
    depth_map: DepthMap,
    normals: Array,
    image_idx: int,
    others: Int,
    load: Callable[[int], DepthMap],
    cameras: OrthographicCameras,
    image_sizes: Array,
    options: SurfaceOptions,
) -> Votes:
    """Compare one depth map with others.

    Parameters
    ----------
    depth_map : of image `image_idx`
    normals : (3, H, W) from `depth_geometry.camera_normals`
    image_idx : of the depth map
    others : image indices of the maps to ask
    load : gives the depth map of an image index
    cameras : of all images
    image_sizes : (M, 2) width, height
    options : tolerances

    """
    shape = depth_map.depth.shape
    unit = depth_map_unit(cameras, image_idx, image_sizes[image_idx], depth_map)
    agreeing = np.zeros(shape, dtype=np.uint8)
    contradicting = np.zeros(shape, dtype=np.uint8)
    sums = np.zeros((3, *shape), dtype=np.float32)
    best_cosine = np.zeros(shape, dtype=np.float32)
    scaling = np.ones((len(cameras), 2))
    scaling[image_idx] = np.array(shape[::-1]) / image_sizes[image_idx]
    for j in others.tolist():
        other = load(j)
        scaling[j] = np.array(other.depth.shape[::-1]) / image_sizes[j]
        sweep = affine_sweep(cameras, image_idx, np.array([j]), scaling)
        relative = cameras.cam_from_world[j] @ cameras.cam_from_world[image_idx].T
        confidence = other.confidence
        if confidence is None:
            confidence = np.ones(other.depth.shape, dtype=np.float32)
        add_votes(
            depth_map.depth,
            normals,
            other.depth,
            confidence,
            sweep.B[0],
            sweep.c[0],
            sweep.e[0],
            _depth_map_from_pixel(cameras, image_idx, relative, scaling[image_idx]),
            relative[2].copy(),
            options.consistency_px * unit,
            options.contradiction_px * unit,
            4.0 * unit,
            agreeing,
            contradicting,
            sums,
            best_cosine,
        )
    total = np.maximum(sums[0], 1e-12)
    mean = sums[1] / total
    spread = np.sqrt(np.maximum(sums[2] / total - mean**2, 0.0))
    return Votes(
        agreeing=agreeing,
        contradicting=contradicting,
        weight=sums[0],
        offset=mean,
        spread=spread,
        best_cosine=best_cosine,
    )


def _depth_map_from_pixel(
    cameras: OrthographicCameras, image_idx: int, relative: Float, scaling: Float
) -> Float:
    """The other camera's depth as ``a . (px, py, z, 1)`` of this one's pixel and depth: (4,)."""
    to_cam = np.linalg.inv(cameras.K2) / cameras.scale_px_per_unit[image_idx]
    linear = relative[2, :2] @ to_cam
    constant = -linear @ cameras.translation_px[image_idx]
    return np.array([*(linear / scaling), relative[2, 2], constant])
