"""From regions to oriented features, and from features to patches."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.patch_kernels import ORIENTATION_RADIUS, orientations, sample_patches
from semsfm_colmap.features.regions import Regions
from semsfm_colmap.features.scale_space import ScaleSpace
from semsfm_colmap.features.selection import rank_within
from semsfm_colmap.types import Array, Features, Float

PIXEL_CENTRE = 0.5
"""COLMAP's coordinates of the first pixel's centre."""
ORIENTATION_PITCH = 0.5
"""Distance of the samples of the orientation histogram, in scales."""


def oriented_features(space: ScaleSpace, regions: Regions, options: DetectorOptions) -> Features:
    """Features (without descriptors) with dominant orientations, or upright."""
    K = len(regions)
    frame = regions.scale_px[:, None, None] * regions.shape
    num = 1 if options.upright else max(options.max_orientations, 1)
    angles, counts = np.zeros((K, num)), np.ones(K, dtype=np.int64)
    if not options.upright and K:
        size = 2 * ORIENTATION_RADIUS + 3
        half_width = 0.5 * size * ORIENTATION_PITCH
        patches = sample(space, regions.xy, frame, half_width, size)
        angles, counts = orientations(patches, num, options.orientation_peak)
    row = np.concatenate([np.flatnonzero(counts > m) for m in range(num)])
    turn = np.concatenate([angles[counts > m, m] for m in range(num)])
    if options.max_num_features > 0:
        # second orientations fill up what is left of the limit, those of strong regions first
        second = np.arange(len(row)) >= K
        rank = rank_within(regions.detector_id, regions.response)[row]
        order = np.lexsort((rank, second))[: options.max_num_features]
        order.sort()
        row, turn = row[order], turn[order]
    order = np.lexsort((turn, row))
    row, turn = row[order], turn[order]
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return Features(
        xy=regions.xy[row] + PIXEL_CENTRE,
        scale_px=regions.scale_px[row],
        angle_rad=turn,
        affine_shape=frame[row] @ rotation,
        response=regions.response[row],
        detector_id=regions.detector_id[row],
        descriptors=np.zeros((len(row), 0), dtype=np.float32),
    )


def patches_of(
    space: ScaleSpace, features: Features, rows: slice, half_width: float, size: int
) -> Array:
    """Normalised patches (K, size, size) float32 of some features.

    The patch spans `half_width` scales to either side of the feature, in its own frame.
    """
    xy = features.xy[rows] - PIXEL_CENTRE
    return sample(space, xy, features.affine_shape[rows], half_width, size)


def sample(space: ScaleSpace, xy: Float, frame: Float, half_width: float, size: int) -> Array:
    """Patches under the maps `frame` (K, 2, 2), each from the level that its narrow axis asks for.

    The shorter semi-axis of the ellipse sets the level: what the longer one would still allow to
    blur is kept rather than smeared across the short one.
    """
    K = len(xy)
    patches = np.zeros((K, size, size), dtype=np.float32)
    octave, level = space.nearest_level(_shorter_axis(frame))
    for o, s in sorted(set(zip(octave.tolist(), level.tolist(), strict=True))):
        rows = np.flatnonzero((octave == o) & (level == s))
        grid = space.octaves[o]
        patches[rows] = sample_patches(
            grid.level(s),
            (xy[rows] - grid.offset) / grid.step,
            frame[rows] / grid.step,
            half_width,
            size,
        )
    return patches


def _shorter_axis(frame: Float) -> Float:
    """Smaller singular value (K,) of (K, 2, 2)."""
    det = np.abs(frame[:, 0, 0] * frame[:, 1, 1] - frame[:, 0, 1] * frame[:, 1, 0])
    half = 0.5 * np.sum(frame**2, axis=(1, 2))
    larger2 = half + np.sqrt(np.maximum(half**2 - det**2, 0.0))
    return np.asarray(det / np.sqrt(np.maximum(larger2, 1e-300)))
