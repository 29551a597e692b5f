"""Linear structure: with the cameras known, each point is a small linear least-squares problem.

For track j with cameras ``xy = A_i X + t_i`` and weights w, the point that minimises
``sum_i w_i |A_i X + t_i - xy_i|^2`` solves ``(sum w A^T A) X = sum w A^T (xy - t)``, 3 x 3.
Observations must be sorted by track; ``track_pointer[j] : track_pointer[j + 1]`` are those of j.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.losses import LOSS_NUMBER, LossName
from semsfm_colmap.geometry.points_kernels import fill_residuals, fit_tracks, solve_tracks
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.types import Array, Float, Int

FIT_CHUNKS = 64
"""Partial sums of the cost, whatever the number of threads."""


def track_pointer(track_idx: Array, num_tracks: int) -> Int:
    """Where each track begins among observations sorted by track: (O,) -> (N + 1,)."""
    counts = np.bincount(track_idx, minlength=num_tracks)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def solve_points(
    A: Float, t: Float, image_idx: Int, pointer: Int, xy: Float, weight: Float
) -> Float:
    """The best point of every track.

    Parameters
    ----------
    A, t : (M, 2, 3), (M, 2), the cameras
    image_idx, xy, weight : (O,), (O, 2), (O,), sorted by track
    pointer : (N + 1,), see `track_pointer`

    Returns
    -------
    (N, 3), nan where the rays of a track do not fix a point

    """
    X = np.empty((len(pointer) - 1, 3))
    with threads_for(len(image_idx)):
        solve_tracks(A, t, image_idx, pointer, xy, weight, X)
    return X


def residuals(A: Float, t: Float, X: Float, image_idx: Int, track_idx: Int, xy: Float) -> Float:
    """``A_i X_j + t_i - xy``: (O, 2) px."""
    r = np.empty((len(image_idx), 2))
    with threads_for(len(image_idx)):
        fill_residuals(A, t, X, image_idx, track_idx, xy, r)
    return r


def fit_points(
    A: Float,
    t: Float,
    image_idx: Int,
    pointer: Int,
    xy: Float,
    precision: Float,
    start_weight: Float,
    *,
    loss: LossName,
    loss_width: float,
    rounds: int,
) -> tuple[Float, Float, Float, float]:
    """Points, residuals, robust weights and the sum of the loss in one pass over the tracks.

    Each round solves for the point with the weights at hand and reweights its observations; one
    round is all that the squared loss needs.

    Parameters
    ----------
    precision : (O,) one over the variance of a coordinate, px^-2
    start_weight : (O,) weights of the first round

    Returns
    -------
    X : (N, 3), zero where the rays of a track do not fix a point
    r : (O, 2) px
    w : (O,) weights at the final residuals
    cost : sum of the loss

    """
    num_tracks = len(pointer) - 1
    X, r = np.empty((num_tracks, 3)), np.empty((len(image_idx), 2))
    w = np.array(start_weight, dtype=np.float64)
    chunk = np.linspace(0, num_tracks, FIT_CHUNKS + 1).astype(np.int64)
    cost = np.zeros(FIT_CHUNKS)
    number, w2 = LOSS_NUMBER[loss], loss_width * loss_width
    with threads_for(rounds * len(image_idx)):
        fit_tracks(
            A, t, image_idx, pointer, xy, precision, number, w2, rounds, chunk, X, r, w, cost
        )
    return X, r, w, float(cost.sum())
