"""Views that were taken more than once: what their frames share is counted once.

Frames of one view have noise of their own. What a window shows, how it is lit and interpolated they
have in common: with rho the correlation of the errors of a point in them, the mean of m frames has
the variance ``sigma^2 (1 + (m - 1) rho) / m``. An observation among m of its track in one view
counts as one of the variance ``d sigma^2``, d = 1 + (m - 1) rho (the design effect of cluster
samples, L. Kish, Survey Sampling, 1965, section 5.4); its weight in the fit stays.

Differences within a view leave the points out and give the variance s^2 of the frames' own noise,
so that ``rho = 1 - s^2 / sigma^2``. With the weights w = 1 / d a track of m_j frames takes three
unknowns from ``2 sum w`` measured numbers, and sigma^2 follows anew. Points and all that several
views tell have right error bars so; the pose of one such frame by itself one too long by up to
``sqrt(d)``, as its errors that the other frames share are taken for its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.types import Float, Int, Observations

SAME_VIEW_DEG = 0.5
"""Frames that differ by less show one view. How much they share is measured all the same."""
MIN_PAIRS = 50
"""Repeated observations from which a correlation is told."""
MIN_CORRELATION = 0.05
NUM_ROUNDS = 5
"""sigma and rho follow from one another; three rounds bring them to a percent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Counted:
    """Observations as they count for error bars."""

    observations: Observations
    sigma_px: float
    num_images: int = 0
    """that show a view which another one shows, too"""
    correlation: float = 0.0
    """of the errors of a point in them"""


def view_numbers(cam_from_world: Float, max_deg: float = SAME_VIEW_DEG) -> Int:
    """Number (M,) of the view of each image: those of one lie within an angle of one another."""
    flat = np.asarray(cam_from_world).reshape(-1, 9)
    # |R_a - R_b| = 2 sqrt(2) sin(angle / 2)
    radius = 2.0 * np.sqrt(2.0) * np.sin(np.deg2rad(max_deg) / 4.0)
    tree = KDTree(flat)
    view = np.full(len(flat), -1, dtype=np.int64)
    for i, place in enumerate(flat):
        if view[i] < 0:
            near = np.array(tree.query_ball_point(place, radius))
            view[near[view[near] < 0]] = i
    return np.asarray(np.unique(view, return_inverse=True)[1], dtype=np.int64)


def counted_once(refined: Refined) -> Counted:
    """The observations of a model with what frames of one view share counted once."""
    obs, sigma = refined.observations, refined.sigma_px
    alone = Counted(observations=obs, sigma_px=sigma)
    view = view_numbers(np.asarray(refined.cameras.cam_from_world))
    key = obs.track_idx * (int(view.max()) + 1) + view[obs.image_idx]
    _, group, size = np.unique(key, return_inverse=True, return_counts=True)
    if size.sum() - len(size) < MIN_PAIRS:
        return alone
    precision = obs.precision
    r = refined.adjustment.state.residuals * np.sqrt(precision)[:, None]
    mean = np.stack([np.bincount(group, r[:, k]) / size for k in range(2)], axis=1)
    own = float(np.sum((r - mean[group]) ** 2) / (2 * (size.sum() - len(size))))
    m = size[group]
    square, per_track = np.sum(r**2, axis=1), np.bincount(obs.track_idx)
    left = np.sum(np.maximum(2 * per_track - 3, 0))
    rho = 0.0
    for _ in range(NUM_ROUNDS):
        weight = 1.0 / (1.0 + (m - 1) * rho)
        remaining = np.sum(np.maximum(2 * np.bincount(obs.track_idx, weight) - 3, 0.0))
        if remaining <= 0.0:
            return alone
        ratio = np.sum(weight * square) / np.sum(square) * left / remaining
        sigma = refined.sigma_px * float(np.sqrt(ratio))
        rho = float(np.clip(1.0 - own / sigma**2, 0.0, 1.0))
    if rho < MIN_CORRELATION:
        return alone
    effect = np.sqrt((1.0 + (m - 1) * rho) / precision)
    return Counted(
        observations=replace(obs, relative_sigma=effect),
        sigma_px=max(sigma, refined.sigma_px),
        num_images=int(np.sum(np.bincount(view)[view] > 1)),
        correlation=rho,
    )


def repeated_notes(counted: Counted) -> list[str]:
    """A sentence where error bars count frames of one view less than others."""
    if counted.num_images == 0:
        return []
    return [
        f"{counted.num_images} images show a view that another of them shows; the errors of a "
        f"point in them correlate by {counted.correlation:.2f}, so that the error bars count them "
        "for less: another angle would tell more"
    ]
