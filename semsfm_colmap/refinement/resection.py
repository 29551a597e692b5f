"""Registering an image against known points: the orthographic resection.

Four points fix an affine camera; random quadruples are tried, the one with the most points within
the threshold wins, and the camera is the scaled rotation nearest to the affine fit of its
supporters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.rotations import nearest_rotation
from semsfm_colmap.geometry.subset import new_numbers
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.types import Bool, Float, Int, Observations, OrthographicCameras, Solution


@dataclass(frozen=True, kw_only=True, eq=False)
class Resection:
    """One camera and the points that support it."""

    cam_from_world: Float
    scale_px_per_unit: float
    translation_px: Float
    inlier: Bool


def affine_camera(points: Float, xy: Float) -> Float:
    """Least-squares ``xy = B [X; 1]``: (L, 3), (L, 2) -> (2, 4)."""
    design = np.column_stack([points, np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(design, xy, rcond=None)[0].T)


def resect(
    points: Float,
    xy: Float,
    *,
    threshold_px: float,
    min_inliers: int,
    rng: np.random.Generator,
    trials: int = 300,
) -> Solution[Resection]:
    """Find the camera that sees `points` (L, 3) at `xy` (L, 2)."""
    n = len(points)
    failure: Solution[Resection] = Solution(
        value=None,
        status="too_few_points",
        message=f"{n} point(s) of the model are seen in the image, fewer than {min_inliers} agree",
    )
    if n < max(min_inliers, 4):
        return failure
    design = np.column_stack([points, np.ones(n)])
    pick = rng.random((trials, n)).argpartition(3, axis=1)[:, :4]
    corners = design[pick]
    regular = np.abs(np.linalg.det(corners)) > 1e-9 * np.std(points) ** 3
    if not regular.any():
        return failure
    B = np.linalg.solve(corners[regular], xy[pick[regular]])  # (T, 4, 2)
    error = np.sum((np.einsum("ld,tdc->tlc", design, B) - xy) ** 2, axis=2)
    count = np.sum(error < threshold_px**2, axis=1)
    inlier = error[int(np.argmax(count))] < threshold_px**2
    for _ in range(3):
        if np.sum(inlier) < min_inliers:
            return failure
        fit = affine_camera(points[inlier], xy[inlier])
        inlier = np.sum((design @ fit.T - xy) ** 2, axis=1) < threshold_px**2
    if np.sum(inlier) < min_inliers:
        return failure
    a, b = fit[:, :3]
    scale = float(np.sqrt((a @ a + b @ b) / 2.0))
    R = nearest_rotation(np.stack([a, b, np.cross(a, b) / scale]) / scale)
    translation = np.mean(xy[inlier] - scale * points[inlier] @ R[:2].T, axis=0)
    predicted = scale * points @ R[:2].T + translation
    inlier = np.sum((predicted - xy) ** 2, axis=1) < (2.0 * threshold_px) ** 2
    if np.sum(inlier) < min_inliers:
        return failure
    return Solution(
        value=Resection(
            cam_from_world=R, scale_px_per_unit=scale, translation_px=translation, inlier=inlier
        )
    )


def register_more(
    images: Int,
    cameras: OrthographicCameras,
    tracks: Int,
    points: Float,
    observations: Observations,
    threshold_px: float,
    options: RefinementOptions,
    rng: np.random.Generator,
) -> tuple[Int, OrthographicCameras]:
    """A model's images (M,) and cameras, and those that resection on its points adds.

    Parameters
    ----------
    tracks, points : (N,) numbers in `observations`, (N, 3)

    """
    position = new_numbers(tracks, observations.num_tracks)
    order = list(images)
    parts = [cameras]
    for i in np.setdiff1d(np.unique(observations.image_idx), images):
        mine = (observations.image_idx == i) & (position[observations.track_idx] >= 0)
        seen = points[position[observations.track_idx[mine]]]
        found = resect(
            seen,
            observations.xy[mine],
            threshold_px=threshold_px,
            min_inliers=max(
                options.min_image_observations,
                math.ceil(options.min_image_inlier_share * len(seen)),
            ),
            rng=rng,
        )
        if found.value is None:
            continue
        order.append(i)
        parts.append(
            OrthographicCameras(
                cam_from_world=found.value.cam_from_world[None],
                scale_px_per_unit=np.array([found.value.scale_px_per_unit]),
                translation_px=found.value.translation_px[None],
                aspect=cameras.aspect,
                skew=cameras.skew,
            )
        )
    merged = replace(
        cameras,
        cam_from_world=np.concatenate([p.cam_from_world for p in parts]),
        scale_px_per_unit=np.concatenate([p.scale_px_per_unit for p in parts]),
        translation_px=np.concatenate([p.translation_px for p in parts]),
        series_idx=None,
    )
    sequence = np.argsort(order)
    return np.array(order, dtype=np.int64)[sequence], merged.select(sequence)
