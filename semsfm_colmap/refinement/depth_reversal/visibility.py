"""What is seen decides: surfaces hide what lies behind them, never what lies before.

near side
    In the views that see it, a point lies nearer to the viewer than in the views that have it in
    their field but do not see it.
bulge
    What is seen of a body in one view is nearer in the middle than at the rim, since at its outline
    a surface turns away.
occlusion order
    Where a point is not seen although it would face the viewer better than in the views that see
    it, something hides it: the surface seen at its place lies nearer. Without the condition on
    facing the order misleads: at the rim of a bump the flank before the step is seen edge-on and
    missed, the ground behind it is seen.
covered steps
    The same without the condition, for steps so high that no flank explains them.

The first two are true of what is convex as a whole. They count only for bodies with background
around them, and together no more than hollow bodies are rare: a dome and a bowl seen from above
differ by nothing but the hand. The other two rest on opaqueness alone.

Facing is ``|n . d|``, n the normal of the plane through neighbouring points, d the viewing
direction: even under reversal, as a condition must be. The t statistics change their sign exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.subset import spread_over
from semsfm_colmap.refinement.depth_reversal.cue import (
    CONVEX_CUES,
    CONVEX_MAX_LOGIT,
    MAX_LOGIT,
    Cue,
    cue_from_t,
    region_t,
    silent,
)
from semsfm_colmap.types import Bool, Float, Int, Observations, OrthographicCameras

# Guided by the fit to simulated scenes of benchmarks/depth_sign, rounded down where a cue
# is strong; the fit and these are side by side in docs/depth_reversal.md, and why two are above it.
NEAR_LOGIT_PER_T = 0.35
BULGE_LOGIT_PER_T = 0.6
ORDER_LOGIT_PER_T = 0.1
STEPS_LOGIT_PER_T = 0.75

NORMAL_NEIGHBOURS = 16
"""Neighbours that fix the plane at a point."""
MIN_POINTS = 100
"""A model of fewer observed points has no surface to speak of."""
MIN_VIEW_POINTS = 20
"""A view that sees fewer points says nothing of what hides what."""
ORDER_CELL = 0.6
"""Cell in which a seen and an unseen point count as being in one place, in units of the mean
spacing of the seen points."""
ORDER_STEP = 1.0
"""Smallest difference in depth that counts, in cells."""
FACING_MARGIN = 0.05
"""How much better than in the views that see it a point must face the viewer. Least biased of the
margins tried on simulated fields, where 0 gave t down to -3 in the right hand."""
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
MAX_RIM_FACING = 0.92
"""Facing of the seen points near their outline relative to that in the middle: 0.5 to 0.85 on nine
in ten simulated bodies, above 0.9 on as many fields. Keeps a patch of a field, cut out by a mask
or by focus, from passing for a body."""
MIDDLE_SHARE, RIM_SHARE = 0.5, 0.15
"""Parts of the seen points, by distance from their middle, that count as middle and as rim."""


SHAPE_CUES = ("bulge",)
"""Cues that ask where the surface is, and not which views miss a point of it: the more points a
model has the better, also those that were looked for with the model."""
CUES = {
    "near side": (NEAR_LOGIT_PER_T, CONVEX_MAX_LOGIT),
    "bulge": (BULGE_LOGIT_PER_T, CONVEX_MAX_LOGIT),
    "occlusion order": (ORDER_LOGIT_PER_T, MAX_LOGIT),
    "covered steps": (STEPS_LOGIT_PER_T, MAX_LOGIT),
}


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
    names: Collection[str] = tuple(CUES),
    max_points: int = 20000,
    max_images: int = 120,
) -> dict[str, Cue]:
    """The cues of the module's docstring for the hand of the model given.

    Parameters
    ----------
    observations : inliers only
    image_size_px : (M, 2) width, height
    names : the cues wanted
    max_points, max_images : larger models are thinned evenly to so many

    """
    observed = np.unique(observations.track_idx)
    if len(observed) < MIN_POINTS:
        return {name: silent() for name in names}
    pick = observed[spread_over(len(observed), max_points)]
    views = _who_sees_what(cameras, points, observations, image_size_px, pick, max_images)
    spacing, body = _framing(views)
    facing_well = views.facing > _mean_over(views.seen, views.facing) + FACING_MARGIN
    value: dict[str, Callable[[], Float]] = {
        "near side": lambda: _near_side(views),
        "bulge": lambda: _bulge(views),
        "occlusion order": lambda: _order(views, facing_well, ORDER_CELL * spacing, ORDER_STEP),
        "covered steps": lambda: _order(views, views.inside, STEPS_CELL * spacing, STEPS_STEP),
    }
    cues = {}
    for name in names:
        logit_per_t, max_logit = CUES[name]
        t, num = region_t(value[name](), views.points)
        speaks = body or name not in CONVEX_CUES
        cues[name] = cue_from_t(t, num, logit_per_t, max_logit) if speaks else silent(t, num)
    return cues


def _who_sees_what(
    cameras: OrthographicCameras,
    points: Float,
    observations: Observations,
    image_size_px: Int,
    pick: Int,
    max_images: int,
) -> _Views:
    """Tabulate the points picked in the views."""
    views = spread_over(len(cameras), max_images)
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


def _framing(views: _Views) -> tuple[float, bool]:
    """Mean spacing of the points seen in a view, px, and whether the views show a body.

    A body has background around it, and turns away from the viewer toward its outline.
    """
    spacing, free, middle, rim = [], [], [], []
    for i, front in _seen_in_views(views):
        xy, size = views.xy[i, front], views.image_size_px[i]
        low, left, right, high = np.percentile(xy, [1, 5, 95, 99], axis=0)
        # the box of nine tenths in both directions holds about 0.81 of the points
        spacing.append(np.sqrt(np.prod(right - left) / (0.81 * len(front))))
        free += [*(low > FREE_SHARE * size), *(high < (1.0 - FREE_SHARE) * size)]
        rank = np.argsort(_squared_distance(_planes(xy)), kind="stable")
        facing = views.facing[i, front[rank]]
        middle.append(facing[: int(MIDDLE_SHARE * len(front))].mean())
        rim.append(facing[-int(RIM_SHARE * len(front)) :].mean())
    if not spacing:
        return 0.0, False
    turns_away = float(np.mean(rim)) < MAX_RIM_FACING * float(np.mean(middle))
    return float(np.median(spacing)), float(np.mean(free)) >= MIN_FREE_SIDES and turns_away


def _seen_in_views(views: _Views) -> Iterator[tuple[int, Int]]:
    """Every view that sees enough points, with the numbers of those it sees."""
    for i, seen in enumerate(views.seen):
        front = np.flatnonzero(seen)
        if len(front) >= MIN_VIEW_POINTS:
            yield i, front


def _planes(xy: Float) -> Float:
    """(L, 3) orthonormal basis of the functions ``a + b x + c y`` over points (L, 2)."""
    centred = xy - xy.mean(axis=0)
    return np.asarray(np.linalg.qr(np.column_stack([np.ones(len(xy)), centred]))[0])


def _squared_distance(basis: Float) -> Float:
    """(L,) squared Mahalanobis distance from the mean, of mean 2, from the basis of `_planes`."""
    return np.asarray(np.sum(basis[:, 1:] ** 2, axis=1) * len(basis))


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


def _bulge(views: _Views) -> Float:
    """(N,) mean, over the views that see a point, of (squared distance from the middle) x (depth).

    The squared distance is in standard deviations of the seen points (Mahalanobis), and both
    factors are residuals of a plane over the image: a flat specimen gives zero however it leans.
    """
    num = len(views.points)
    total, count = np.zeros(num), np.zeros(num)
    for i, front in _seen_in_views(views):
        basis = _planes(views.xy[i, front])
        both = np.column_stack([_squared_distance(basis), views.depth[i, front]])
        both -= basis @ (basis.T @ both)
        total[front] += both[:, 0] * both[:, 1]
        count[front] += 1.0
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


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
    for i, front in _seen_in_views(views):
        hidden = np.flatnonzero(views.inside[i] & ~views.seen[i] & use[i])
        if len(hidden) == 0 or cell_px <= 0.0:
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
