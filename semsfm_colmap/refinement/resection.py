"""Registering an image against known points: the orthographic resection.

Four points fix an affine camera; random quadruples are tried, the one with the most points within
the threshold wins, and the camera is the scaled rotation nearest to the affine fit of its
supporters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.rotations import nearest_rotation
from semsfm_colmap.types import Bool, Float, Solution


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
