r"""A sheet that carries the specimen and reaches the border of the images all around.

Seen from above (against the mean viewing direction) the substrate is the smooth height field that
passes through what touches the border: a quadric ``h = q(u, v)`` of six numbers, fitted with
Cauchy's weights, and the robust deviation sigma of what it was fitted to. A specimen is what stands
out by more than `min_height_sigma` sigma in one connected patch that does not reach the border, but
for strays: it holds less than `MAX_REACHING` of what touches it. A rough field that fills the frame
has no such patch: its own relief is sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.segmentation.patches import connected_patches
from semsfm_colmap.types import Bool, Float

NUM_FITS = 20
CAUCHY_TUNING = 2.385
"""95 % efficiency on Gaussian errors (Holland and Welsch 1977)."""
MAX_LOG_ODDS = 6.0
"""Bound on what a height says: 1 in 400."""
MAX_REACHING = 0.1
"""Share of what touches the border that may hang on a specimen."""
MIN_FITTED = 60
"""Points that a quadric of six numbers is trusted with."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Substrate:
    """A substrate, in the coordinates of N points."""

    height: Float
    """(N,) above the sheet, toward the viewer"""
    sigma: float
    """deviation of the sheet itself"""
    raised: Bool
    """(N,) specimen without doubt"""
    level: Bool
    """(N,) substrate without doubt: at the border, on the sheet"""
    between: Bool
    """(N,) seen from above, among the points that are level: elsewhere the sheet is a guess"""


def find_substrate(
    points: Float,
    touches: Bool,
    viewing_direction: Float,
    spacing: float,
    options: SegmentationOptions,
) -> Substrate | None:
    """The sheet through what touches the border; None where nothing stands out of it.

    Parameters
    ----------
    points : (N, 3)
    touches : (N,) points at the border of the images
    viewing_direction : (3,) mean of the images, into the scene
    spacing : of the points, world units

    """
    up = -viewing_direction / np.linalg.norm(viewing_direction)
    across = points @ np.linalg.svd(up[None])[2][1:].T
    z = points @ up
    if touches.sum() < MIN_FITTED:
        return None
    middle, extent = across.mean(axis=0), np.ptp(across, axis=0).max()
    u, v = ((across - middle) / extent).T
    basis = np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])
    height, sigma = _fit(basis, z, touches)
    sigma = max(sigma, 0.5 * spacing)
    high = height > options.min_height_sigma * sigma
    raised = np.zeros(len(points), dtype=bool)
    for patch in connected_patches(points, high, options.num_graph_neighbors):
        large = len(patch) >= options.min_part_share * len(points)
        if large and touches[patch].sum() < MAX_REACHING * touches.sum():
            raised[patch] = True
    if not raised.any():
        return None
    level = touches & (np.abs(height) < 0.5 * options.min_height_sigma * sigma)
    if level.sum() < MIN_FITTED:
        return None
    return Substrate(
        height=height, sigma=sigma, raised=raised, level=level, between=_between(across, level)
    )


def log_odds(sheet: Substrate) -> Float:
    """Substrate against specimen from the height: (N,).

    Heights of the substrate are Gaussian, those of the specimen uniform up to its top; what is
    below the sheet is a dent in it. Where the sheet is a guess there is none.
    """
    t = np.maximum(sheet.height, 0.0) / sheet.sigma
    top = max(float(np.percentile(t[sheet.raised], 95.0)), 1.0)
    odds = np.clip(np.log(top / np.sqrt(2.0 * np.pi)) - 0.5 * t * t, -MAX_LOG_ODDS, MAX_LOG_ODDS)
    return np.where(sheet.between, odds, -MAX_LOG_ODDS)


def _between(across: Float, level: Bool) -> Bool:
    """Points in the convex hull of those that are level: (N, 2), (N,) -> (N,)."""
    from scipy.spatial import ConvexHull

    # joggled, so that points on a line have a hull as well
    sides = ConvexHull(across[level], qhull_options="QJ").equations
    return np.asarray(level | np.all(across @ sides[:, :2].T + sides[:, 2] <= 0.0, axis=1))


def _fit(basis: Float, z: Float, rows: Bool) -> tuple[Float, float]:
    weight = np.ones(int(rows.sum()))
    sigma = 0.0
    for _ in range(NUM_FITS):
        root = np.sqrt(weight)
        q = np.linalg.lstsq(root[:, None] * basis[rows], root * z[rows], rcond=None)[0]
        off = z[rows] - basis[rows] @ q
        sigma = MAD_TO_SIGMA * float(np.median(np.abs(off))) + 1e-300
        weight = 1.0 / (1.0 + (off / (CAUCHY_TUNING * sigma)) ** 2)
    return np.asarray(z - basis @ q), sigma
