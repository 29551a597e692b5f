r"""Residuals of a tilt series view by view, and what they are of points that did not see them.

With the cameras of the exported files, ``q_o = L_i X_j + q_i``, each point is the least squares
solution of its own observations, ``X_j = N_j^-1 sum_o L_o^T q_o``, ``N_j = sum_o L_o^T L_o``. With
``H_o = L_o N_j^-1 L_o^T`` the residual of an observation against the point that the *others* of
its track give is ``(I - H_o)^-1 r_o``, exactly (the deletion formula of linear least squares: Cook
and Weisberg, Residuals and Influence in Regression, 1982, section 2.2): the leave-out error. It is
undefined where the others do not determine the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float, Int

MIN_DETERMINANT = 1e-9
"""Of I - H: below it the other observations leave the point free in some direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewErrors:
    """Mean lengths in px by view; nan where a view has none."""

    residual_px: Float
    leave_out_px: Float
    num_points: Int


def view_errors(linear: Float, middle_px: Float, image: Int, track: Int, xy: Float) -> ViewErrors:
    """Errors of M views.

    Parameters
    ----------
    linear : (M, 2, 3) L
    middle_px : (M, 2) q
    image, track, xy : (O,), (O,), (O, 2) observations

    """
    L = linear[image]
    num_tracks = int(track.max(initial=-1)) + 1
    N, rhs = np.zeros((num_tracks, 3, 3)), np.zeros((num_tracks, 3))
    np.add.at(N, track, np.einsum("oki,okj->oij", L, L))
    np.add.at(rhs, track, np.einsum("oki,ok->oi", L, xy - middle_px[image]))
    inverse = np.linalg.pinv(N, hermitian=True)
    X = np.einsum("nij,nj->ni", inverse, rhs)
    residual = np.einsum("oij,oj->oi", L, X[track]) + middle_px[image] - xy
    rest = np.eye(2) - np.einsum("oki,oij,olj->okl", L, inverse[track], L)
    determined = np.linalg.det(rest) > MIN_DETERMINANT
    left_out = np.full(residual.shape, np.nan)
    left_out[determined] = np.linalg.solve(rest[determined], residual[determined, :, None])[..., 0]
    num_views = len(linear)
    return ViewErrors(
        residual_px=_mean_by(image, np.linalg.norm(residual, axis=1), num_views),
        leave_out_px=_mean_by(image, np.linalg.norm(left_out, axis=1), num_views),
        num_points=np.bincount(image, minlength=num_views).astype(np.int64),
    )


def longest_tracks(track: Int, count: int) -> Int:
    """The tracks with the most observations, in their order."""
    length = np.bincount(track)
    chosen = np.argsort(-length, kind="stable")[:count]
    return np.sort(chosen[length[chosen] > 0]).astype(np.int64)


def _mean_by(group: Int, value: Float, num_groups: int) -> Float:
    known = np.isfinite(value)
    total = np.bincount(group[known], value[known], num_groups)
    count = np.bincount(group[known], minlength=num_groups)
    return np.asarray(np.divide(total, count, out=np.full(num_groups, np.nan), where=count > 0))
