"""Orthographic cameras as small picture frames around the object (the paper's figures 16 and 17).

An orthographic image fixes where its rays run, not how far away the viewer is. Each frame sits on
the ray through the centre of its image, at one arbitrary distance from the object: in the plane
its place is real, along the ray it is chosen so that object and frames can both be seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float, Int, Reconstruction

VIEW_PERCENTILE = 1.0
"""Points outside these percentiles (widened by `VIEW_MARGIN`) do not set the view."""
VIEW_MARGIN = 0.5
"""Fraction of the box by which it is widened on each side."""
DISTANCE_RADII = 2.2
FRAME_WIDTH_RADII = 0.42
LABEL_STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
MAX_LABELS = 10
UP_MARK = 0.45
"""Height of the mark on the upper edge, relative to the frame's half height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """The part of the world that is worth looking at."""

    center: Float
    """(3,)"""
    radius: float


def find_view(points: Float) -> View:
    """Centre and radius of the bulk of the points, stray ones aside."""
    if len(points) == 0:
        return View(center=np.zeros(3), radius=1.0)
    low, high = np.percentile(points, [VIEW_PERCENTILE, 100.0 - VIEW_PERCENTILE], axis=0)
    center = 0.5 * (low + high)
    radius = 0.5 * float(np.max(high - low))
    return View(center=center, radius=radius if radius > 0.0 else 1.0)


def inside_view(points: Float, view: View) -> Array:
    """(N,) True for the points that the scene shows: within the radius and a margin."""
    reach = (1.0 + 2.0 * VIEW_MARGIN) * view.radius
    return np.asarray(np.all(np.abs(points - view.center) <= reach, axis=1))


def frame_centers(reconstruction: Reconstruction, view: View) -> Float:
    """(M, 3) where the frames are drawn."""
    rec, cameras = reconstruction, reconstruction.cameras
    in_image = 0.5 * rec.image_size_px - cameras.translation_px
    xy_cam = np.linalg.solve(cameras.K2, (in_image / cameras.scale_px_per_unit[:, None]).T).T
    depth = cameras.viewing_direction @ view.center - DISTANCE_RADII * view.radius
    x_cam = np.concatenate([xy_cam, depth[:, None]], axis=1)
    return np.einsum("iab,ia->ib", cameras.cam_from_world, x_cam)


def frame_outlines(reconstruction: Reconstruction, view: View) -> Float:
    """(M, 8, 3) a closed rectangle with a mark on its upper edge, as one polyline an image."""
    size = reconstruction.image_size_px.astype(np.float64)
    half = 0.5 * FRAME_WIDTH_RADII * view.radius * size / size.max(axis=1, keepdims=True)
    corner = np.array(
        [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1], [0.3, -1], [0, -1 - UP_MARK], [-0.3, -1]]
    )
    order = [0, 7, 6, 5, 1, 2, 3, 0]  # up the mark on the way along the upper edge
    xy = corner[order][None] * half[:, None]
    right, down = reconstruction.cameras.cam_from_world[:, :2].transpose(1, 0, 2)
    offset = xy[..., :1] * right[:, None] + xy[..., 1:] * down[:, None]
    return np.asarray(frame_centers(reconstruction, view)[:, None] + offset)


def labelled_frames(numbers: Int) -> Int:
    """Indices of the frames that carry their number: the first, and round numbers after it."""
    step = next((s for s in LABEL_STEPS if len(numbers) <= s * MAX_LABELS), LABEL_STEPS[-1])
    return np.flatnonzero((numbers % step == 0) | (numbers == numbers[0]))
