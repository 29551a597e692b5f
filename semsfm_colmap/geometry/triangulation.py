"""Robust triangulation of tracks with known cameras [paper, section "3D reconstruction"].

Two parallel-projection views fix a point (four equations, three unknowns). For each track pairs of
its views are tried, the one with the most observations within the threshold wins, ties go to the
smaller error, and the point is fitted to its supporters. With few views all pairs are tried; with
many, pairs drawn by a generator that depends on the seed and the track alone, so the result does
not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.triangulation_kernels import drop_worst, smallest_cosine, triangulate
from semsfm_colmap.types import Bool, Float, Int


def triangulate_tracks(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    *,
    threshold_px: float,
    trials: int,
    seed: int = 0,
) -> tuple[Float, Bool]:
    """Points of all tracks and the observations that support them.

    Parameters
    ----------
    A, t : (M, 2, 3), (M, 2) cameras
    image_idx, xy : (O,), (O, 2), sorted by track
    pointer : (N + 1,)
    threshold_px : reprojection error up to which an observation supports a point

    Returns
    -------
    X : (N, 3), nan where no two views agree
    inlier : (O,)

    """
    num_tracks = len(pointer) - 1
    X = np.full((num_tracks, 3), np.nan)
    inlier = np.zeros(len(image_idx), dtype=bool)
    triangulate(A, t, image_idx, pointer, xy, threshold_px**2, trials, seed, X, inlier)
    return X, inlier


def drop_deviating(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    inlier: Bool,
    *,
    threshold_px: float,
    min_length: int,
) -> Bool:
    """Drop observations that the rest of their track contradicts, the worst first: (O,).

    An observation pulls the point toward itself, the more the further its direction lies from the
    others', and the residual that it leaves is the smaller for it: with M = I - P H^-1 P^T its
    covariance is sigma^2 M, H the sum of P^T P over the track. So ``r^T M^-1 r``, a chi square in
    units of sigma^2 wherever the observation lies, is held against the threshold [Baarda 1968].

    Parameters
    ----------
    A, t, image_idx, pointer, xy, inlier : as `triangulate_tracks` takes and gives them
    min_length : tracks of fewer observations are left as they are

    """
    kept = np.array(inlier)
    drop_worst(A, t, image_idx, pointer, xy, threshold_px**2, min_length, kept)
    return kept


def triangulation_angle(direction: Float, image_idx: Int, pointer: Int, inlier: Bool) -> Float:
    """The widest angle between two viewing directions of each track: (N,) rad."""
    cosine = np.ones(len(pointer) - 1)
    smallest_cosine(np.ascontiguousarray(direction), image_idx, pointer, inlier, cosine)
    return np.arccos(np.clip(cosine, -1.0, 1.0))
