"""Depth maps by multi-view stereo under parallel projection.

For each reference image: (1) sweep planes of constant depth at half size, correlate with the
neighbours, smooth semi-globally: a depth for every pixel, in steps; (2) find the background;
(3) from half to full size, fit local planes and move each depth by Gauss-Newton on windows that lie
in these planes, with all neighbours at once: sharp, sub-step, unbiased by slant; (4) drop what no
neighbour confirms and specks. All maps between images are affine and exact (`views.py`), so nothing
is rectified. What single maps cannot know, whether others agree, is left to `consistency.py`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.rasters import Raster, raster_reader
from semsfm_colmap.surface.stereo.refine_kernels import local_planes, slanted_step
from semsfm_colmap.surface.stereo.sgm_kernels import best_label, semi_global_sum
from semsfm_colmap.surface.stereo.sweep_kernels import MAX_COST, correlation_volume
from semsfm_colmap.surface.stereo.views import (
    AffineSweep,
    affine_sweep,
    choose_neighbors,
    depth_range,
)
from semsfm_colmap.types import Array, DepthMap, Float, Int, Reconstruction

_MAX_THREADS = 8
"""Each thread holds a cost volume of some 100 MB."""
_MAX_PLANES = 400
"""Bounds the cost volume when the sparse points spread far in depth."""
_SGM_SMALL_STEP, _SGM_JUMP, _SGM_GREY_SHARE = 6, 40, 0.05
"""P1, P2 in units of 1 % correlation; grey step, as a share of the contrast, that halves P2."""
_TEXTURE_SIGMA = 2.0
"""Windows whose deviation is below this many times the noise's have no texture."""
_BASE_RADIUS_PX = 3
"""Half-size radius of the plane fits that make the base surface of the second sweep."""
_HALO_PX = 4
"""Half-size px that windows reach beyond a silhouette, smoothing included."""
_SPECK_STEP_PX = 3.0
"""Neighbouring depths that differ by more belong to different surfaces."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """Reference and neighbours at one size: everything the kernels need."""

    grey: Array
    usable: Array
    views: Array
    view_usable: Array
    sweep: AffineSweep
    noise: Float
    contrast: float
    unit: float
    """World units per px."""


def sweep_depth_maps(
    reconstruction: Reconstruction,
    references: Int,
    image_path: Path,
    mask_path: Path | None,
    options: SurfaceOptions,
) -> Iterator[DepthMap]:
    """Depth maps of some images, in their order, computed in parallel and as they are asked for."""
    num_threads = max(1, min(os.cpu_count() or 1, _MAX_THREADS, len(references)))
    num_cached = num_threads * (options.num_neighbors + 1)
    full = options.max_depth_map_size_px
    readers = [
        raster_reader(
            image_path,
            mask_path,
            reconstruction.image_names,
            reconstruction.image_size_px,
            size,
            num_cached,
        )
        for size in (full // 2, full)
    ]

    def job(reference: int) -> DepthMap:
        return sweep_depth_map(reconstruction, reference, readers, options)

    with ThreadPoolExecutor(num_threads) as pool:
        waiting: list[Future[DepthMap]] = []
        try:
            for reference in references.tolist():
                waiting.append(pool.submit(job, reference))
                if len(waiting) > num_threads:
                    yield waiting.pop(0).result()
            while waiting:
                yield waiting.pop(0).result()
        finally:
            for future in waiting:
                future.cancel()


def sweep_depth_map(
    reconstruction: Reconstruction,
    reference: int,
    readers: list[Callable[[int], Raster]],
    options: SurfaceOptions,
) -> DepthMap:
    """The depth map of one image; all nan when no neighbour gives parallax.

    Parameters
    ----------
    reconstruction : cameras, and points for the range of depths
    reference : image index
    readers : images at half and at full size
    options : sizes, windows, thresholds

    """
    from semsfm_colmap.surface.stereo.background import background, uncorrelated_region

    name = reconstruction.image_names[reference]
    shape = readers[-1](reference).grey.shape
    nothing = DepthMap(
        image_name=name,
        depth=np.full(shape, np.nan, dtype=np.float32),
        confidence=np.zeros(shape, dtype=np.float32),
    )
    neighbors = choose_neighbors(
        reconstruction.cameras,
        reference,
        num=options.num_neighbors,
        min_angle_rad=np.radians(options.min_baseline_deg),
        max_angle_rad=np.radians(options.max_baseline_deg),
    )
    limits = depth_range(reconstruction, reference, options.depth_margin)
    if len(neighbors) == 0 or limits is None:
        return nothing

    coarse = _level(reconstruction, reference, neighbors, readers[0])
    planes = np.full(coarse.grey.shape, np.float32(0.5 * (limits[0] + limits[1])))
    half_range = 0.5 * (limits[1] - limits[0])
    depth, score = _sweep(coarse, planes, half_range, options)
    empty = uncorrelated_region(score, _HALO_PX)
    depth[background(coarse.grey, empty, _HALO_PX, float(coarse.noise[0]))] = np.nan
    base = local_planes(depth, score, _BASE_RADIUS_PX, 2.5 * coarse.unit)

    fine = _level(reconstruction, reference, neighbors, readers[1])
    base = _enlarge(base, fine.grey.shape)
    half_range = min(half_range, options.max_relief_px * fine.unit)
    depth, score = _sweep(fine, base, half_range, options)
    empty = _enlarge_mask(empty, fine.grey.shape)
    depth[background(fine.grey, empty, 2 * _HALO_PX, float(fine.noise[0]))] = np.nan
    depth[~fine.usable] = np.nan
    depth, score = _refine(fine, depth, score, options)
    outside = (depth < limits[0]) | (depth > limits[1])
    depth[(score < options.min_correlation) | outside] = np.nan
    depth = _drop_specks(depth, fine.unit, options.min_speck_px)
    depth[: options.window_radius_px] = depth[-options.window_radius_px :] = np.nan
    depth[:, : options.window_radius_px] = depth[:, -options.window_radius_px :] = np.nan
    score[~np.isfinite(depth)] = 0.0
    return DepthMap(image_name=name, depth=depth, confidence=np.clip(score, 0.0, 1.0))


def _level(
    reconstruction: Reconstruction, reference: int, neighbors: Int, reader: Callable[[int], Raster]
) -> _Level:
    """Read the reference and its neighbours, pad the neighbours to one size."""
    rasters = [reader(int(j)) for j in neighbors]
    ref = reader(reference)
    sizes = reconstruction.image_size_px
    scaling = np.ones((reconstruction.num_images, 2))
    for j, raster in zip([reference, *neighbors.tolist()], [ref, *rasters], strict=True):
        scaling[j] = np.array(raster.grey.shape[::-1]) / sizes[j]
    height = max(r.grey.shape[0] for r in rasters)
    width = max(r.grey.shape[1] for r in rasters)
    mean = np.float32(ref.grey.mean())
    views = np.zeros((len(rasters), height, width), dtype=np.float32)
    usable = np.zeros(views.shape, dtype=np.uint8)
    for j, raster in enumerate(rasters):
        h, w = raster.grey.shape
        views[j, :h, :w] = raster.grey - mean
        usable[j, :h, :w] = raster.usable
    low, high = np.percentile(ref.grey[::4, ::4], [1.0, 99.0])
    scale = reconstruction.cameras.scale_px_per_unit[reference] * scaling[reference].mean()
    return _Level(
        grey=ref.grey - mean,
        usable=ref.usable,
        views=views,
        view_usable=usable,
        sweep=affine_sweep(reconstruction.cameras, reference, neighbors, scaling),
        noise=np.array([max(r.noise, 0.25) for r in [ref, *rasters]]),
        contrast=max(float(high - low), 1.0),
        unit=float(1.0 / scale),
    )


def _sweep(
    level: _Level, base: Array, half_range: float, options: SurfaceOptions
) -> tuple[Array, Array]:
    """Depth within `half_range` of a base surface, and the best correlation: (H, W) each.

    Correlation volume, semi-global smoothing of the offsets from the base, vertex of the parabola.
    Only the rectangle with texture is swept; beside it the depth is nan and the correlation 0.
    """
    depth = np.full(level.grey.shape, np.nan, dtype=np.float32)
    score = np.zeros(level.grey.shape, dtype=np.float32)
    rows, columns = _textured(level, base, margin=4 * options.sweep_window_radius_px)
    grey = np.ascontiguousarray(level.grey[rows, columns])
    near = np.array(base[rows, columns])
    known = np.isfinite(near)
    if not known.any():
        return depth, score
    near[~known] = np.median(near[known])
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
    total = semi_global_sum(
        cost, grey, _SGM_SMALL_STEP, _SGM_JUMP, _SGM_GREY_SHARE * level.contrast
    )
    label = best_label(total)
    nearest = np.rint(label).astype(np.int64)[..., None]
    best = np.take_along_axis(cost, nearest, axis=2)[..., 0]
    near += offsets[0] + label * (offsets[1] - offsets[0])
    near[~known] = np.nan
    depth[rows, columns] = near
    score[rows, columns] = np.where(known, 1.0 - best / np.float32(MAX_COST), 0.0)
    return depth, score


def _refine(
    level: _Level, depth: Array, score: Array, options: SurfaceOptions
) -> tuple[Array, Array]:
    """Gauss-Newton on windows that lie in the local planes: sharper depth, its correlation."""
    window, window_weight = _window(options.window_radius_px)
    gradient = _epipolar_gradient(level)
    for _ in range(options.num_refinements):
        plane = local_planes(depth, score, options.slope_radius_px, 2.5 * level.unit)
        slanted_step(
            level.grey,
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
            depth,
            score,
        )
    return depth, score


def _textured(level: _Level, base: Array, margin: int) -> tuple[slice, slice]:
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


def _sides(parallax: Float) -> Int:
    """Which side of the reference each neighbour is on, along the main direction: (V,) 0 or 1."""
    main = np.linalg.svd(parallax, full_matrices=False)[2][0]
    return np.asarray(parallax @ main > 0, dtype=np.int64)


def _epipolar_gradient(level: _Level) -> Array:
    """Grey and its change with depth, ``grad I . c``, side by side: (V, H, W, 2) float32."""
    import cv2

    out = np.empty((*level.views.shape, 2), dtype=np.float32)
    for j, view in enumerate(level.views):
        out[j, ..., 0] = view
        dx = cv2.Scharr(view, cv2.CV_32F, 1, 0) / 32.0
        dy = cv2.Scharr(view, cv2.CV_32F, 0, 1) / 32.0
        out[j, ..., 1] = level.sweep.c[j, 0] * dx + level.sweep.c[j, 1] * dy
    return out


def _enlarge(plane: Array, shape: tuple[int, ...]) -> Array:
    """Depths at a larger size from local planes: each small pixel's plane, evaluated inside it.

    Nothing is interpolated between two pixels, so no depths between two surfaces are invented.
    """
    height, width = plane.shape[1:]
    v = (np.arange(shape[0]) + 0.5) * height / shape[0] - 0.5
    u = (np.arange(shape[1]) + 0.5) * width / shape[1] - 0.5
    iv = np.clip(np.rint(v).astype(np.int64), 0, height - 1)
    iu = np.clip(np.rint(u).astype(np.int64), 0, width - 1)
    z, p, q = plane[:, iv[:, None], iu[None, :]]
    return np.asarray(z + p * (u - iu)[None, :] + q * (v - iv)[:, None], dtype=np.float32)


def _enlarge_mask(mask: Array, shape: tuple[int, ...]) -> Array:
    import cv2

    large = cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(large > 0)


def _drop_specks(depth: Array, unit: float, min_px: int) -> Array:
    """Without connected patches of fewer than `min_px` pixels."""
    import cv2

    finite = np.isfinite(depth)
    if not finite.any() or min_px <= 1:
        return depth
    # filterSpeckles works on 16-bit integers: quantise in quarter px, wide ranges coarser
    low = float(depth[finite].min())
    quantum = max(0.25 * unit, (float(depth[finite].max()) - low) / 30_000)
    steps = np.full(depth.shape, -1_000, dtype=np.int16)
    steps[finite] = np.rint((depth[finite] - low) / quantum).astype(np.int16)
    cv2.filterSpeckles(steps, -1_000, min_px, max(1, round(_SPECK_STEP_PX * unit / quantum)))
    return np.where(steps == -1_000, np.float32(np.nan), depth)
