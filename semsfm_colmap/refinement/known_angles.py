"""Known rotation angles between images as a prior of the bundle adjustment.

A stage or an actuator gives angles about one axis that the images do not know. Only differences
count. For a pair (a, b) with ``R_ab = R_a R_b^T`` of angle theta about the axis n,

    residual = (theta - |known_a - known_b|) / sigma,   d theta = n . (w_a - w_b),

w the left-multiplied rotation steps; n is the same in both camera frames because R_ab leaves it
alone. The sign of the rotation is not used: it is the hand, which other evidence decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.motion.prior import TiltPrior, known_tilts
from semsfm_colmap.motion.stage import known_rotations, rotation_pairs
from semsfm_colmap.types import Float, Int

TARGET_RAD = np.deg2rad(60.0)
"""Pairs are taken about this far apart, or half the range when that is less: a long lever, and no
ambiguity near half a turn."""
MIN_RAD = np.deg2rad(0.5)
"""Closer pairs have no well-defined axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AnglePrior:
    """Known angles between pairs of images."""

    pairs: Int
    """(P, 2) image numbers"""
    angle_rad: Float
    """(P,) positive"""
    sigma_rad: Float
    """(P,)"""

    def residuals(
        self, cam_from_world: Float, param_idx: Int, num_params: int
    ) -> tuple[Float, sparse.csr_array]:
        """Residuals in sigmas (P,) and their Jacobian (P, num_params)."""
        R = np.asarray(cam_from_world)
        a, b = self.pairs[:, 0], self.pairs[:, 1]
        v = vector_from_rotation(R[a] @ R[b].transpose(0, 2, 1))
        theta = np.linalg.norm(v, axis=1)
        n = v / np.maximum(theta, 1e-12)[:, None] / self.sigma_rad[:, None]
        r = (theta - self.angle_rad) / self.sigma_rad
        P = len(r)
        rows = np.repeat(np.arange(P), 6)
        cols = np.concatenate([param_idx[a, :3], param_idx[b, :3]], axis=1).ravel()
        values = np.concatenate([n, -n], axis=1).ravel()
        free = cols >= 0
        J = sparse.csr_array((values[free], (rows[free], cols[free])), shape=(P, num_params))
        return r, J


def stage_angle_prior(prior: TiltPrior, names: Sequence[str]) -> AnglePrior | None:
    """Pairs of some images from what is known of the stage: tilts, or tilts and rotations."""
    tilt, sigma = known_tilts(prior, names)
    rotations = known_rotations(prior, names)
    if rotations is None:
        return angle_prior(tilt, sigma)
    there = np.isfinite(rotations).all(axis=(1, 2))
    if there.sum() < 2:
        return None
    _, angles = rotation_pairs(rotations, np.pi, 0.0)
    span = float(angles.max(initial=0.0))
    if span < MIN_RAD:
        return None
    apart = max(min(TARGET_RAD, span / 2.0), MIN_RAD)
    pairs, angle = rotation_pairs(rotations, apart, MIN_RAD)
    good = angle < np.deg2rad(170.0)
    if not good.any():
        return None
    pairs, angle = pairs[good], angle[good]
    return AnglePrior(
        pairs=pairs,
        angle_rad=angle,
        sigma_rad=np.sqrt(2.0 * (sigma[pairs] ** 2).sum(axis=1)),
    )


def angle_prior(known_rad: Float, sigma_rad: Float) -> AnglePrior | None:
    """Pairs from known angles (M,), nan where unknown; None when they do not vary.

    Each image is paired with the next one that is far enough away in angle. The errors of the
    images, not of the pairs, are independent; each image is in about two pairs, so the pairs'
    variances are doubled to keep the weight of the prior what the data sheet says.
    """
    known = np.flatnonzero(np.isfinite(known_rad))
    if len(known) < 2:
        return None
    order = known[np.argsort(known_rad[known], kind="stable")]
    angles = known_rad[order]
    span = float(angles[-1] - angles[0])
    if span < MIN_RAD:
        return None
    apart = max(min(TARGET_RAD, span / 2.0), MIN_RAD)
    partner = np.searchsorted(angles, angles + apart - 1e-9)
    first = np.flatnonzero(partner < len(angles))
    a, b = order[partner[first]], order[first]
    difference = known_rad[a] - known_rad[b]
    good = difference < np.deg2rad(170.0)
    if not good.any():
        return None
    a, b, difference = a[good], b[good], difference[good]
    variance = sigma_rad[a] ** 2 + sigma_rad[b] ** 2
    return AnglePrior(
        pairs=np.column_stack([a, b]),
        angle_rad=difference,
        sigma_rad=np.sqrt(2.0 * variance if len(known) > 2 else variance),
    )
