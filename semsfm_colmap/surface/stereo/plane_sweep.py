"""Sweep a surface through depth: which offset makes the neighbours agree with the reference?

The first sweep moves a plane of constant depth, the second one the surface that the first has
found, so that its windows lie on the slopes. Correlation in windows, then semi-global smoothing.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.level import Level
from semsfm_colmap.surface.stereo.sgm_kernels import (
    best_label,
    semi_global_sum,
    surface_jumps,
)
from semsfm_colmap.surface.stereo.sweep_kernels import MAX_COST, correlation_volume
from semsfm_colmap.types import Array, Bool, Float, Int

_MAX_PLANES = 400
"""Bounds the cost volume when the sparse points spread far in depth."""
_SGM_SMALL_STEP, _SGM_JUMP, _SGM_GREY_SHARE = 6, 40, 0.05
"""P1, P2 in units of 1 % correlation; grey step, as a share of the contrast, that halves P2."""
_TEXTURE_SIGMA = 2.0
"""Windows whose deviation is below this many times the noise's have no texture."""


def sweep_depths(
    level: Level, base: Array, half_range: float, options: SurfaceOptions
) -> tuple[Array, Array]:
    """Depth within `half_range` of a base surface, and the best correlation: (H, W) each.

    Correlation volume, semi-global smoothing of the surface, vertex of the parabola. Only the
    rectangle with texture is swept; beside it the depth is nan and the correlation 0.

    Parameters
    ----------
    level : the reference and its neighbours
    base : (3, H, W) depths and slopes along x and y, nan where unknown
    half_range : world units
    options : step, window

    """
    depth = np.full(level.grey.shape, np.nan, dtype=np.float32)
    score = np.zeros(level.grey.shape, dtype=np.float32)
    rows, columns = _textured(level, base[0], margin=4 * options.sweep_window_radius_px)
    grey = np.ascontiguousarray(level.grey[rows, columns])
    surface = np.array(base[:, rows, columns])
    near = surface[0]
    known = np.isfinite(near)
    if not known.any():
        return depth, score
    near[:] = _filled(near, known)
    corner = np.array([columns.start, rows.start], dtype=np.float64)

    parallax = np.linalg.norm(level.sweep.c, axis=1).max()
    num = int(np.ceil(2.0 * half_range * parallax / options.sweep_step_px)) + 1
    offsets = np.linspace(-half_range, half_range, min(max(num, 3), _MAX_PLANES))
    cost = correlation_volume(
        grey,
        near,
        level.views,
        level.view_usable,
        level.sweep.B,
        level.sweep.c,
        level.sweep.e + level.sweep.B @ corner,
        offsets,
        options.sweep_window_radius_px,
        level.noise,
        _sides(level.sweep.c),
    )
    step = float(offsets[1] - offsets[0])
    total = semi_global_sum(
        cost,
        grey,
        surface_jumps(surface, step),
        _SGM_SMALL_STEP,
        _SGM_JUMP,
        _SGM_GREY_SHARE * level.contrast,
    )
    label = best_label(total, len(offsets))
    nearest = np.rint(label).astype(np.int64)[..., None]
    best = np.take_along_axis(cost, nearest, axis=2)[..., 0]
    near += offsets[0] + label * step
    near[~known] = np.nan
    depth[rows, columns] = near
    score[rows, columns] = np.where(known, 1.0 - best / np.float32(MAX_COST), 0.0)
    return depth, score


def _filled(depth: Array, known: Bool) -> Array:
    """Unknown depths as the nearest known one: others would enter windows and paths beside them."""
    from scipy.ndimage import distance_transform_edt

    if known.all():
        return depth
    row, column = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(depth[row, column])


def _textured(level: Level, base: Array, margin: int) -> tuple[slice, slice]:
    """The rectangle around all windows with a base whose deviation clearly exceeds the noise."""
    import cv2

    mean = cv2.blur(level.grey, (5, 5))
    variance = cv2.blur(level.grey * level.grey, (5, 5)) - mean * mean
    textured = (
        (variance > (_TEXTURE_SIGMA * level.noise[0]) ** 2) & level.usable & np.isfinite(base)
    )
    textured = cv2.erode(textured.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    spans = []
    for axis, size in ((1, level.grey.shape[0]), (0, level.grey.shape[1])):
        hit = np.flatnonzero(textured.any(axis=axis))
        low, high = (hit[0], hit[-1] + 1) if len(hit) else (0, size)
        spans.append(slice(max(0, int(low) - margin), min(size, int(high) + margin)))
    return spans[0], spans[1]


def _sides(parallax: Float) -> Int:
    """Which side of the reference each neighbour is on, along the main direction: (V,) 0 or 1."""
    main = np.linalg.svd(parallax, full_matrices=False)[2][0]
    return np.asarray(parallax @ main > 0, dtype=np.int64)
