"""What is seen decides: surfaces hide what lies behind them, never what lies before.

near side
    In the views that see it, a point lies nearer to the viewer than in the views that have it in
    their field but do not see it. True of what is convex as a whole: it counts only for bodies
    with background around them, and no more than hollow bodies are rare, for a dome and a bowl
    seen from above differ by nothing but the hand.
occlusion order
    Where a point is not seen although it would face the viewer at least as well as in the views
    that see it, something hides it: the surface seen at its place lies nearer. Without the
    condition on facing the order misleads: at the rim of a bump the flank before the step is seen
    edge-on and missed, the ground behind it is seen.
covered steps
    The same without the condition, for steps so high that no flank explains them, on bodies.

Facing is ``|n . d|``, n the normal of the plane through neighbouring points, d the viewing
direction: even under reversal, as a condition must be. The t statistics change their sign exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.refinement.depth_reversal.cue import (
    MAX_LOGIT,
    Cue,
    cue_from_t,
    region_t,
    silent,
)
from semsfm_colmap.types import Bool, Float, Int, Observations, OrthographicCameras

# fitted on simulated scenes: scripts/benchmark_depth_sign.py, table in docs/depth_reversal.md
NEAR_LOGIT_PER_T = 0.8
NEAR_MAX_LOGIT = 3.9
"""Log odds of 0.98: about one body in fifty with background around it is hollow toward the viewer
(cups, broken shells, craters whose surroundings have no texture). An assumption, not a fit."""
ORDER_LOGIT_PER_T = 0.6
STEPS_LOGIT_PER_T = 0.8

NORMAL_NEIGHBOURS = 16
"""Neighbours that fix the plane at a point."""
MIN_POINTS = 100
"""A model of fewer points has no surface to speak of."""
MIN_VIEW_POINTS = 20
"""A view that sees fewer points says nothing of what hides what."""
ORDER_CELL = 0.6
"""Cell in which a seen and an unseen point count as being in one place, in units of the mean
spacing of the seen points."""
ORDER_STEP = 1.0
"""Smallest difference in depth that counts, in cells."""
STEPS_CELL = 1.0
STEPS_STEP = 4.0
"""A step of four cells is a slope of 76 degrees within one: what is so steep is hardly detected."""
MIN_STEP_PX = 4.0
"""Depths of points are uncertain by about so much (shading alone moves features 1 to 3 px)."""
BORDER_SHARE = 0.01
"""Part of the image, along its border, where features are not found."""
FREE_SHARE = 0.06
"""A side of an image is free when points stay so far, of its width, from it."""
MIN_FREE_SIDES = 0.5
"""Share of sides that are free in views of a body: bodies on a stalk have 0.75, fields 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Views:
    """Who sees what: M views, N points."""

    points: Float
    depth: Float
    """(M, N) px"""
    xy: Float
    """(M, N, 2) px"""
    inside: Bool
    """(M, N) in the image"""
    seen: Bool
    """(M, N)"""
    facing: Float
    """(M, N) |n . d|"""
    image_size_px: Int
    """(M, 2)"""


def visibility_cues(
    cameras: OrthographicCameras,
    points: Float,
    observations: Observations,
    image_size_px: Int,
    *,
    max_points: int = 20000,
    max_images: int = 120,
) -> dict[str, Cue]:
    """The cues of the module's docstring for the hand of the model given.

    Parameters
    ----------
    observations : inliers only
    image_size_px : (M, 2) width, height
    max_points, max_images : larger models are thinned evenly to so many

    """
    if len(points) < MIN_POINTS:
        return {name: silent() for name in ("near side", "occlusion order", "covered steps")}
    views = _who_sees_what(cameras, points, observations, image_size_px, max_points, max_images)
    spacing, free = _density(views)
    near, num_near = region_t(_near_side(views), views.points)
    facing_well = views.facing >= _mean_over(views.seen, views.facing)
    order, num_order = region_t(
        _order(views, facing_well, ORDER_CELL * spacing, ORDER_STEP), views.points
    )
    steps, num_steps = region_t(
        _order(views, np.ones_like(facing_well), STEPS_CELL * spacing, STEPS_STEP), views.points
    )
    body = free >= MIN_FREE_SIDES
    return {
        "near side": cue_from_t(near, num_near, NEAR_LOGIT_PER_T, NEAR_MAX_LOGIT)
        if body
        else silent(near, num_near),
        "occlusion order": cue_from_t(order, num_order, ORDER_LOGIT_PER_T, MAX_LOGIT),
        "covered steps": cue_from_t(steps, num_steps, STEPS_LOGIT_PER_T, MAX_LOGIT)
        if body
        else silent(steps, num_steps),
    }


def _who_sees_what(
    cameras: OrthographicCameras,
    points: Float,
    observations: Observations,
    image_size_px: Int,
    max_points: int,
    max_images: int,
) -> _Views:
    """Thin the model and tabulate it."""
    pick = np.unique(np.linspace(0, len(points) - 1, min(max_points, len(points))).astype(int))
    views = np.unique(np.linspace(0, len(cameras) - 1, min(max_images, len(cameras))).astype(int))
    number = np.full(len(points), -1)
    number[pick] = np.arange(len(pick))
    view_number = np.full(len(cameras), -1)
    view_number[views] = np.arange(len(views))
    seen = np.zeros((len(views), len(pick)), dtype=bool)
    v, p = view_number[observations.image_idx], number[observations.track_idx]
    ok = (v >= 0) & (p >= 0)
    seen[v[ok], p[ok]] = True
    X, chosen, size = points[pick], cameras.select(views), np.asarray(image_size_px)[views]
    direction = chosen.viewing_direction
    xy = np.einsum("mij,nj->mni", chosen.projection, X, optimize=True)
    xy += chosen.translation_px[:, None]
    margin = BORDER_SHARE * size.max()
    inside = np.all((xy > margin) & (xy < size[:, None] - margin), axis=2)
    return _Views(
        points=X,
        depth=direction @ X.T * chosen.scale_px_per_unit[:, None],
        xy=xy,
        inside=inside,
        seen=seen,
        facing=np.abs(direction @ surface_normals(X).T),
        image_size_px=size,
    )


def surface_normals(points: Float, neighbours: int = NORMAL_NEIGHBOURS) -> Float:
    """Unit normals (N, 3) of the planes through each point and its neighbours, either sign."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(points).query(points, k=min(neighbours + 1, len(points)))[1]
    around = points[nearest]
    around = around - around.mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)
    return np.asarray(vectors[:, :, 0])


def _mean_over(mask: Bool, value: Float) -> Float:
    """(N,) mean of `value` over the views of the mask; 0 where there are none."""
    total = np.einsum("mn,mn->n", mask, value)
    return np.asarray(total / np.maximum(mask.sum(axis=0), 1))


def _density(views: _Views) -> tuple[float, float]:
    """Mean spacing of the points seen in a view, px, and the share of sides without points."""
    spacing, free = [], []
    for xy, seen, size in zip(views.xy, views.seen, views.image_size_px, strict=True):
        if seen.sum() < MIN_VIEW_POINTS:
            continue
        low, left, right, high = np.percentile(xy[seen], [1, 5, 95, 99], axis=0)
        # the box of nine tenths in both directions holds about 0.81 of the points
        spacing.append(np.sqrt(np.prod(right - left) / (0.81 * seen.sum())))
        free += [*(low > FREE_SHARE * size), *(high < (1.0 - FREE_SHARE) * size)]
    if not spacing:
        return 0.0, 0.0
    return float(np.median(spacing)), float(np.mean(free))


def _near_side(views: _Views) -> Float:
    """(N,) depth of a point in the views that miss it less that in those that see it.

    Depths are relative to what lies in the field of each view, in units of their spread.
    """
    in_field = views.inside | views.seen
    unseen = views.inside & ~views.seen
    relative = views.depth.copy()
    for row, use in zip(relative, in_field, strict=True):
        if use.any():
            row -= np.median(row[use])
    spread = float(np.std(relative[in_field])) if in_field.any() else 0.0
    value = _mean_over(unseen, relative) - _mean_over(views.seen, relative)
    both = views.seen.any(axis=0) & unseen.any(axis=0) & (spread > 0.0)
    return np.where(both, value / (spread or 1.0), np.nan)


def _order(views: _Views, use: Bool, cell_px: float, step: float) -> Float:
    """(N,) in -1..1: mean sign of the depth of an unseen point less that of the surface seen there.

    Parameters
    ----------
    use : (M, N) where an unseen point may speak
    cell_px : size of the cells that compare points; two grids, half a cell apart
    step : smallest difference that counts, in cells

    """
    num = len(views.points)
    total, count = np.zeros(num), np.zeros(num)
    threshold = max(step * cell_px, MIN_STEP_PX)
    for i in range(len(views.depth) if cell_px > 0.0 else 0):
        front = np.flatnonzero(views.seen[i])
        hidden = np.flatnonzero(views.inside[i] & ~views.seen[i] & use[i])
        if len(front) < MIN_VIEW_POINTS or len(hidden) == 0:
            continue
        low = views.xy[i, front].min(axis=0)
        shape = np.ceil(np.ptp(views.xy[i, front], axis=0) / cell_px).astype(np.int64) + 3
        for shift in (1.0, 1.5):
            at = np.floor((views.xy[i] - low) / cell_px + shift).astype(np.int64)
            at = np.clip(at, 0, shape - 1)  # outermost cells hold nothing seen
            cell = at[:, 0] * shape[1] + at[:, 1]
            filled = np.bincount(cell[front], minlength=int(np.prod(shape)))
            depth = np.bincount(
                cell[front], weights=views.depth[i, front], minlength=int(np.prod(shape))
            )
            covered = hidden[filled[cell[hidden]] > 0]
            behind = views.depth[i, covered] - depth[cell[covered]] / filled[cell[covered]]
            clear = np.abs(behind) > threshold
            total[covered[clear]] += np.sign(behind[clear])
            count[covered[clear]] += 1.0
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
