"""Which hand? Depth reversal decided by visibility.

(R, X) and (D R D, D X), D = diag(1, 1, -1), have identical orthographic images, so no residual
tells them apart. What is seen does: surfaces hide what lies behind them, never what lies before.

near side
    In the views that see it, a point lies nearer to the viewer than it does in the views that have
    it in their field but do not see it. Decides bodies.
occlusion order
    Where a view has a point in its field but does not see it, the surface seen there should lie
    nearer to the viewer than the point. Decides overhangs, gaps and the flanks of rough fields.

Each cue is one number a point, odd under reversal. Neighbouring points share their occluders, so
the numbers are averaged over regions of the object, and the regions are the independent samples of
a t statistic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from semsfm_colmap.geometry.rotations import depth_reversed
from semsfm_colmap.types import (
    Bool,
    DepthSign,
    Float,
    Int,
    Observations,
    OrthographicCameras,
)

NUM_REGIONS = 48
"""Regions the object is divided into; each is one sample."""
LOGIT_PER_T = 0.8
"""Log odds per unit of a cue's t statistic: below 1 because regions are not quite independent and
missed detections are not quite random."""
MAX_LOGIT = 9.0
"""No cue alone claims more than 1 - 1e-4."""
MIN_REGIONS = 8
"""Fewer informative regions than this say nothing."""
SURFACE_NEIGHBOURS = 6
"""Seen points that stand for the visible surface at an unseen point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cue:
    """One kind of evidence for the hand at hand."""

    t: float
    """t statistic, positive for the hand at hand"""
    num_regions: int
    probability: float


def regions(points: Float, count: int) -> Int:
    """Divide points into compact regions of similar size by cutting along the longest axis."""
    label = np.zeros(len(points), dtype=np.int64)
    parts = [np.arange(len(points))]
    while len(parts) < count:
        parts.sort(key=len)
        largest = parts.pop()
        if len(largest) < 8:
            parts.append(largest)
            break
        extent = np.ptp(points[largest], axis=0)
        order = largest[np.argsort(points[largest, int(np.argmax(extent))], kind="stable")]
        half = len(order) // 2
        parts += [order[:half], order[half:]]
    for k, part in enumerate(parts):
        label[part] = k
    return label


def cue_from_points(value: Float, label: Int) -> Cue:
    """T statistic of the mean over regions of a number a point (nan: no say)."""
    good = np.isfinite(value)
    if not good.any():
        return Cue(t=0.0, num_regions=0, probability=0.5)
    count = np.bincount(label[good])
    total = np.bincount(label[good], weights=value[good])
    means = (total / np.maximum(count, 1))[count >= 3]
    n = len(means)
    if n < MIN_REGIONS:
        return Cue(t=0.0, num_regions=n, probability=0.5)
    spread = float(np.std(means, ddof=1))
    t = float(np.mean(means) / max(spread / np.sqrt(n), 1e-12))
    logit = float(np.clip(LOGIT_PER_T * t, -MAX_LOGIT, MAX_LOGIT))
    return Cue(t=t, num_regions=n, probability=1.0 / (1.0 + np.exp(-logit)))


def _fields(
    cameras: OrthographicCameras, points: Float, image_size_px: Int
) -> tuple[Float, Float, Bool]:
    """Depth (M, N), image position (M, N, 2) and whether the point is inside the image (M, N)."""
    depth = cameras.viewing_direction @ points.T * cameras.scale_px_per_unit[:, None]
    xy = np.einsum("mij,nj->mni", cameras.projection, points) + cameras.translation_px[:, None]
    margin = 0.01 * image_size_px.max()
    inside = np.all((xy > margin) & (xy < image_size_px[:, None] - margin), axis=2)
    return depth, xy, inside


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
    max_points, max_images : larger models are thinned evenly to so many

    """
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
    X = points[pick]
    depth, xy, inside = _fields(cameras.select(views), X, image_size_px[views])
    unseen = inside & ~seen
    label = regions(X, NUM_REGIONS)

    # depths relative to what lies in the field of each view
    in_field = np.where(inside | seen, depth, np.nan)
    with np.errstate(all="ignore"):
        centre = np.array(
            [np.nanmedian(row) if np.isfinite(row).any() else 0.0 for row in in_field]
        )
    relative = depth - centre[:, None]
    n_seen, n_unseen = seen.sum(axis=0), unseen.sum(axis=0)
    both = (n_seen > 0) & (n_unseen > 0)
    near = np.full(len(X), np.nan)
    mean_seen = np.where(seen, relative, 0.0).sum(axis=0) / np.maximum(n_seen, 1)
    mean_unseen = np.where(unseen, relative, 0.0).sum(axis=0) / np.maximum(n_unseen, 1)
    near[both] = (mean_unseen - mean_seen)[both]

    # depth of an unseen point behind the surface seen at its place
    total, count = np.zeros(len(X)), np.zeros(len(X))
    for i in range(len(views)):
        front, hidden = np.flatnonzero(seen[i]), np.flatnonzero(unseen[i])
        if len(front) < 4 * SURFACE_NEIGHBOURS or len(hidden) == 0:
            continue
        tree = cKDTree(xy[i, front])
        spacing = np.asarray(tree.query(xy[i, front], k=SURFACE_NEIGHBOURS + 1)[0])
        typical = float(np.median(spacing[:, -1]))
        distance, nearest = tree.query(xy[i, hidden], k=SURFACE_NEIGHBOURS)
        distance, nearest = np.asarray(distance), np.asarray(nearest)
        covered = distance[:, -1] < 2.0 * typical
        surface = np.median(depth[i, front][nearest], axis=1)
        behind = depth[i, hidden] - surface
        # within the roughness of the surface nothing is said
        clear = covered & (np.abs(behind) > typical)
        total[hidden[clear]] += np.sign(behind[clear])
        count[hidden[clear]] += 1
    order = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return {
        "near side": cue_from_points(near, label),
        "occlusion order": cue_from_points(order, label),
    }


def reverse_depth(cameras: OrthographicCameras, points: Float) -> tuple[OrthographicCameras, Float]:
    """The twin with the same images: ``R -> D R D``, ``X -> D X``."""
    from dataclasses import replace

    twin = replace(cameras, cam_from_world=depth_reversed(np.asarray(cameras.cam_from_world)))
    return twin, points * np.array([1.0, 1.0, -1.0])


def decide_depth_sign(cues: dict[str, Cue], min_confidence: float) -> tuple[DepthSign, bool]:
    """Fuse the cues into a verdict; True when the model at hand must be reversed.

    The cues see the same occlusions, so their log odds are averaged where they agree; where they
    contradict each other they cancel.
    """
    logits = [float(np.log(c.probability / (1.0 - c.probability))) for c in cues.values()]
    informative = [x for x in logits if x != 0.0]
    total = float(np.sum(informative)) / np.sqrt(max(len(informative), 1))
    reverse = bool(total < 0.0)
    confidence = float(1.0 / (1.0 + np.exp(-min(abs(total), MAX_LOGIT))))
    evidence = {
        name: (1.0 - c.probability if reverse else c.probability) for name, c in cues.items()
    }
    resolved = confidence >= min_confidence
    detail = ", ".join(f"{name} {p:.3f}" for name, p in evidence.items())
    message = (
        f"the hand is decided by visibility with confidence {confidence:.3f} ({detail})"
        if resolved
        else f"visibility does not decide the hand (confidence {confidence:.3f}: {detail}); both "
        "models are written; a known direction of the tilt would settle it"
    )
    return (
        DepthSign(
            status="resolved" if resolved else "ambiguous",
            confidence=confidence,
            evidence=evidence,
            message=message,
        ),
        reverse,
    )
