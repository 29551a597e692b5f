"""A stage with two axes: tilt and rotation together.

On a SEM's stage the table that rotates stands on the one that tilts: rotation turns the specimen
about the table's normal, tilt turns the table about an axis fixed in the chamber. So with x along
that axis

    R = Rx(tilt) Rz(rotation),

up to a turn of the scan and the zeros of both scales, which are unknown. What is compared is the
angle between two views, ``angle(R_a R_b^T)``, which neither a turn of the scan nor the sign of one
of the two scales changes (a reflection turns it round). The zero of the tilt matters: it is where
the table's normal lies along the view, and stages are set up so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry import losses
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.types import Float, Int

MIN_VIEWS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class RotationLine:
    """``seen = slope known`` for the angles between views whose tilt and rotation are known."""

    slope: float
    residual_rad: Float
    """(K,) of each view the median over its pairs"""
    seen_range_rad: float
    """Largest angle between two views, as seen"""
    known_range_rad: float
    leverage_rad: float
    """Root of the sum of the squared angles of the views from their mean, as known"""


def stage_rotations(tilt_rad: Float, rotation_rad: Float) -> Float:
    """``Rx(tilt) Rz(rotation)`` (M, 3, 3); nan where either is unknown."""
    t, r = np.asarray(tilt_rad, dtype=np.float64), np.asarray(rotation_rad, dtype=np.float64)
    zero, one = np.zeros_like(t + r), np.ones_like(t + r)
    ct, st, cr, sr = np.cos(t), np.sin(t), np.cos(r), np.sin(r)
    about_x = np.array([[one, zero, zero], [zero, ct, -st], [zero, st, ct]])
    about_z = np.array([[cr, -sr, zero], [sr, cr, zero], [zero, zero, one]])
    return np.einsum("ijm,jkm->mik", about_x, about_z)


def known_rotations(prior: TiltPrior, names: Sequence[str]) -> Float | None:
    """Of some images (M, 3, 3), nan where nothing is known; None where the stage only tilted."""
    if prior.rotation_rad is None:
        return None
    number = {name: k for k, name in enumerate(prior.image_names)}
    rows = np.array([number.get(name, -1) for name in names], dtype=np.int64)
    tilt = np.append(prior.angle_rad, np.nan)[rows]
    return stage_rotations(tilt, np.append(prior.rotation_rad, np.nan)[rows])


def rotation_line(known: Float, seen: Float) -> RotationLine | None:
    """Compare the angles between all views by robust least squares (Huber) through zero.

    None for fewer than three views, or where nothing turns.

    Parameters
    ----------
    known, seen : (K, 3, 3) rotations, all finite

    """
    count = len(known)
    if count < MIN_VIEWS:
        return None
    a, b = np.triu_indices(count, 1)
    x = rotation_angle(known[a] @ known[b].transpose(0, 2, 1))
    y = rotation_angle(seen[a] @ seen[b].transpose(0, 2, 1))
    if float(x.max()) < math.radians(0.5):
        return None
    weight = np.ones(len(x))
    slope = 1.0
    for _ in range(20):
        slope = float(np.sum(weight * x * y) / np.sum(weight * x * x))
        residual = y - slope * x
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-9)
        weight = losses.weight("huber", (residual / scale) ** 2, losses.HUBER_TUNING)
    off = np.zeros((count, count))
    off[a, b] = off[b, a] = residual
    others = off[~np.eye(count, dtype=bool)].reshape(count, count - 1)
    worst = np.median(np.abs(others), axis=1)
    return RotationLine(
        slope=slope,
        residual_rad=worst,
        seen_range_rad=float(y.max()),
        known_range_rad=float(x.max()),
        leverage_rad=float(np.sqrt(np.sum(x * x) / count)),
    )


def rotation_pairs(known: Float, apart_rad: float, least_rad: float) -> tuple[Int, Float]:
    """Pairs (P, 2) of views about so far apart, and the angles (P,) between them.

    Each view is paired with the one whose distance is nearest to `apart_rad`.
    """
    there = np.flatnonzero(np.isfinite(known).all(axis=(1, 2)))
    pairs: set[tuple[int, int]] = set()
    for a in there:
        angle = rotation_angle(known[there] @ known[a].T)
        b = there[int(np.argmin(np.abs(angle - apart_rad)))]
        if b != a:
            pairs.add((min(int(a), int(b)), max(int(a), int(b))))
    found = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
    angle = rotation_angle(known[found[:, 0]] @ known[found[:, 1]].transpose(0, 2, 1))
    good = angle >= least_rad
    return found[good], np.asarray(angle[good])
