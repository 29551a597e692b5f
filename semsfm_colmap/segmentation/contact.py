"""Where the surface leaves the images: which points, on which sides, how much of the outline.

A point touches side e of the frame when its projection lies within a margin of that side, or
beyond it, in at least half of the images. For a specimen that turns about an axis the sides that
the axis passes through are the only ones that a point can touch for the whole turn; the outward
normal of the side, taken into the world by each camera and averaged, is then the direction in
which the specimen is held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.types import Bool, Float, Int, OrthographicCameras

OUTWARD = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
"""Left, right, top, bottom."""
NUM_BINS = 24
"""Bins along each side, in which its coverage is counted."""
MIN_BIN_POINTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class BorderContact:
    """Contact of N points with the four sides of the frame: left, right, top, bottom."""

    touches: Bool
    """(N, 4)"""
    coverage: Float
    """(4,) share of each side along which the surface touches it"""
    direction: Float
    """(4, 3) mean outward normal of each side in the world; shorter than 1 where it turns"""

    @property
    def total_coverage(self) -> float:
        """Share of the whole outline."""
        return float(self.coverage.mean())


def find_contact(
    points: Float, cameras: OrthographicCameras, image_size_px: Int, options: SegmentationOptions
) -> BorderContact:
    """Which points touch the border of the images.

    Parameters
    ----------
    points : (N, 3) world units
    cameras : M of them
    image_size_px : (M, 2) width, height

    """
    near = np.zeros((len(points), 4))
    along = np.zeros((len(points), 2))
    for i in range(len(cameras)):
        size = image_size_px[i].astype(np.float64)
        margin = options.border_margin * size.min()
        uv = points @ cameras.projection[i].T + cameras.translation_px[i]
        near += np.column_stack([uv < margin, uv > size - margin])[:, [0, 2, 1, 3]]
        along += uv / size
    touches = near >= options.min_border_share * len(cameras)
    along /= len(cameras)
    coverage = np.zeros(4)
    for side in range(4):
        position = along[touches[:, side], 1 if side < 2 else 0]
        inside = np.clip(position, 0.0, 1.0 - 1e-9)
        count = np.bincount((inside * NUM_BINS).astype(np.int64), minlength=NUM_BINS)
        coverage[side] = float(np.mean(count >= MIN_BIN_POINTS))
    direction = np.einsum("ek,ikj->ej", OUTWARD, cameras.cam_from_world[:, :2]) / len(cameras)
    return BorderContact(touches=touches, coverage=coverage, direction=direction)
