"""Depth maps by multi-view stereo under parallel projection.

For each reference image: (1) sweep planes of constant depth at half size, correlate with the
neighbours, smooth semi-globally: a depth for every pixel, in steps; (2) find the background;
(3) from half to full size, sweep the surface that local planes make of it, and move each depth by
Gauss-Newton on windows that lie on such a surface, with all neighbours at once, the reference seen
in the light of each (`relight`): sharp, sub-step, unbiased by slant; (4) drop what no neighbour
confirms and specks. All maps between images are affine and exact (`views.py`), so nothing
is rectified. What single maps cannot know, whether others agree, is left to the fusion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import BoundedSemaphore

import numpy as np

from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.background import background, uncorrelated_region
from semsfm_colmap.surface.stereo.level import read_level
from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.surface.stereo.plane_sweep import sweep_depths
from semsfm_colmap.surface.stereo.rasters import Raster, raster_reader
from semsfm_colmap.surface.stereo.refine import refine_depths
from semsfm_colmap.surface.stereo.relight import change_of_light, light_of
from semsfm_colmap.surface.stereo.undrag import depth_without_drag
from semsfm_colmap.surface.stereo.views import choose_neighbors, depth_range
from semsfm_colmap.types import Array, DepthMap, Float, Int, ParallelMap, Reconstruction

_MAX_AT_A_TIME = 8
"""Each map in the making holds a cost volume of some 100 MB."""
_BASE_RADIUS_PX = 3
"""Half-size radius of the plane fits that make the base surface of the second sweep."""
_HALO_PX = 4
"""Half-size px that windows reach beyond a silhouette, smoothing included."""
_SPECK_STEP_PX = 3.0
"""Neighbouring depths that differ by more belong to different surfaces."""


def sweep_depth_maps(
    reconstruction: Reconstruction,
    references: Int,
    image_path: Path,
    mask_path: Path | None,
    options: SurfaceOptions,
    *,
    parallel_map: ParallelMap = map,
    num_at_a_time: int = 1,
) -> Iterator[DepthMap]:
    """Depth maps of some images, in their order, computed as they are asked for.

    Parameters
    ----------
    reconstruction : cameras, and points for the range of depths
    references : image indices
    image_path, mask_path : folders of the prepared images and of ``<image name>.png``, 0 = ignore
    options : sizes, windows, thresholds
    parallel_map : over the references
    num_at_a_time : how many of them it works on at a time: the images of so many are kept

    """
    num_at_a_time = max(1, min(num_at_a_time, _MAX_AT_A_TIME, len(references)))
    job = _Sweep(reconstruction, image_path, mask_path, options, num_at_a_time)
    return parallel_map(job, references.tolist())


class _Sweep:
    """`sweep_depth_map` with what the maps of a series have in common.

    Pickled for another process it reads its images there.
    """

    def __init__(
        self,
        reconstruction: Reconstruction,
        image_path: Path,
        mask_path: Path | None,
        options: SurfaceOptions,
        num_at_a_time: int,
        light: Float | None = None,
    ) -> None:
        self.given = reconstruction, image_path, mask_path, options, num_at_a_time
        full = options.max_depth_map_size_px
        self.readers = [
            raster_reader(
                image_path,
                mask_path,
                reconstruction.image_names,
                reconstruction.image_size_px,
                size,
                num_at_a_time * (options.num_neighbors + 1),
                reconstruction.drift_px,
            )
            for size in (full // 2, full)
        ]
        self.light = light_of(reconstruction, self.readers[0]) if light is None else light
        self.room = BoundedSemaphore(_MAX_AT_A_TIME)

    def __reduce__(self) -> tuple[object, ...]:
        return _Sweep, (*self.given, self.light)

    def __call__(self, reference: int) -> DepthMap:
        reconstruction, _, _, options, _ = self.given
        with self.room:
            return sweep_depth_map(reconstruction, reference, self.readers, self.light, options)


def sweep_depth_map(
    reconstruction: Reconstruction,
    reference: int,
    readers: list[Callable[[int], Raster]],
    light: Float,
    options: SurfaceOptions,
) -> DepthMap:
    """The depth map of one image; all nan when no neighbour gives parallax.

    Parameters
    ----------
    reconstruction : cameras, and points for the range of depths
    reference : image index
    readers : images at half and at full size
    light : (3,) gradient of the shading, `relight.light_of`
    options : sizes, windows, thresholds

    """
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

    coarse = read_level(reconstruction, reference, neighbors, readers[0])
    planes = np.zeros((3, *coarse.grey.shape), dtype=np.float32)
    planes[0] = 0.5 * (limits[0] + limits[1])
    half_range = 0.5 * (limits[1] - limits[0])
    depth, score = sweep_depths(coarse, planes, half_range, options)
    empty = uncorrelated_region(score, coarse.grey, _HALO_PX)
    depth[background(coarse.grey, empty, _HALO_PX, float(coarse.noise[0]))] = np.nan
    base = local_planes(depth, score, _BASE_RADIUS_PX, 2.5 * coarse.unit)

    fine = read_level(reconstruction, reference, neighbors, readers[1])
    base = _enlarge(base, fine.grey.shape)
    half_range = min(half_range, options.max_relief_px * fine.unit)
    depth, score = sweep_depths(fine, base, half_range, options)
    empty = _enlarge_mask(empty, fine.grey.shape)
    depth[background(fine.grey, empty, 2 * _HALO_PX, float(fine.noise[0]))] = np.nan
    depth[~fine.usable] = np.nan
    cameras = reconstruction.cameras
    change = change_of_light(light, np.asarray(cameras.cam_from_world), reference, neighbors)
    depth, score, sigma = refine_depths(fine, cameras, reference, change, depth, score, options)
    outside = (depth < limits[0]) | (depth > limits[1])
    depth[(score < options.min_correlation) | outside] = np.nan
    depth = _drop_specks(depth, fine.unit, options.min_speck_px)
    depth[: options.window_radius_px] = depth[-options.window_radius_px :] = np.nan
    depth[:, : options.window_radius_px] = depth[:, -options.window_radius_px :] = np.nan
    score[~np.isfinite(depth)] = 0.0
    found = DepthMap(image_name=name, depth=depth, confidence=np.clip(score, 0.0, 1.0), sigma=sigma)
    return depth_without_drag(found, reconstruction, reference, options.slope_radius_px)


def _enlarge(plane: Array, shape: tuple[int, ...]) -> Array:
    """Local planes (3, H, W) at a larger size: each small pixel's plane, evaluated inside it.

    Nothing is interpolated between two pixels, so no depths between two surfaces are invented.
    """
    height, width = plane.shape[1:]
    v = (np.arange(shape[0]) + 0.5) * height / shape[0] - 0.5
    u = (np.arange(shape[1]) + 0.5) * width / shape[1] - 0.5
    iv = np.clip(np.rint(v).astype(np.int64), 0, height - 1)
    iu = np.clip(np.rint(u).astype(np.int64), 0, width - 1)
    z, p, q = plane[:, iv[:, None], iu[None, :]]
    z = z + p * (u - iu)[None, :] + q * (v - iv)[:, None]
    p, q = p * (width / shape[1]), q * (height / shape[0])
    return np.asarray(np.stack([z, p, q]), dtype=np.float32)


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
