"""Masks of the specimen, projected into the images: COLMAP's convention, 255 = use, 0 = ignore."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.segmentation.splat import first_points
from semsfm_colmap.types import Array, Bool, Float, OrthographicCameras

CLOSING_CELLS = 2
"""Gaps up to this radius, in cells of the cloud's spacing, are closed."""
MARGIN_PX = 4
"""Masks reach this far beyond the points: the outline of a surface is seen by few depth maps."""


def part_mask(
    points: Float,
    part: Bool,
    cameras: OrthographicCameras,
    image_idx: int,
    size: tuple[int, int],
    spacing: float,
) -> Array:
    """Where an image shows a part, and not something in front of it: (H, W) uint8, 255 or 0.

    Parameters
    ----------
    points : (N, 3)
    part : (N,)
    cameras, image_idx : the image
    size : its width and height
    spacing : of the points, world units

    """
    import cv2

    cell = max(1.0, spacing * float(cameras.scale_px_per_unit[image_idx]))
    uv = points @ cameras.projection[image_idx].T + cameras.translation_px[image_idx]
    first = first_points(uv, points @ cameras.viewing_direction[image_idx], size, cell)
    shown = np.where(first >= 0, part[first], False).astype(np.uint8)
    other = ((first >= 0) & (shown == 0)).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * CLOSING_CELLS + 1,) * 2)
    shown = cv2.morphologyEx(shown, cv2.MORPH_CLOSE, kernel, borderType=cv2.BORDER_REPLICATE)

    def full(cells: Array) -> Array:
        y = np.minimum((np.arange(size[1]) + 0.5) / cell, cells.shape[0] - 1).astype(np.int64)
        x = np.minimum((np.arange(size[0]) + 0.5) / cell, cells.shape[1] - 1).astype(np.int64)
        return np.asarray(cells[y[:, None], x])

    margin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * MARGIN_PX + 1,) * 2)
    grown = cv2.dilate(full(shown), margin)
    # the margin does not reach into what else is there
    return np.where((grown > 0) & (full(other) == 0), np.uint8(255), np.uint8(0))
