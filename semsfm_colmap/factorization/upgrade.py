"""Euclidean upgrade [Quan 1996; paper, equations 4, 5].

The affine cameras A_i become ``A_i L`` with rows that are orthogonal and of equal length, the
magnification of the image. With ``Q = L L^T`` the constraints are linear in the six entries of Q:

    a Q a - b Q b = 0,   a Q b = 0,   (a Q a + b Q b) / 2 = 1 (magnification near its prior),

a, b the rows of A_i. The linear solution starts a refinement over lower-triangular L with positive
diagonal, so Q is positive definite by construction: a linear solution that is not, is only a start
that has been moved inside, and is reported. The rank of the linear system says what the views
determine: two views leave one direction free, a pure in-plane rotation three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from semsfm_colmap.geometry.rotations import nearest_rotation
from semsfm_colmap.records import UpgradeFigures
from semsfm_colmap.types import AffineModel, Float, OrthographicCameras, Solution

MIN_RELATIVE_SINGULAR_VALUE = 1e-7
"""Singular values of the constraint system below this share of the largest count as zero."""
_LOWER = np.tril_indices(3)


def quadratic_form(u: Float, v: Float) -> Float:
    """Coefficients of ``u^T Q v`` in (Q00, Q10, Q11, Q20, Q21, Q22): (M, 3) x 2 -> (M, 6)."""
    q = u[:, :, None] * v[:, None, :]
    q = q + q.transpose(0, 2, 1)
    q[:, np.arange(3), np.arange(3)] /= 2.0
    return np.asarray(q[:, _LOWER[0], _LOWER[1]])


def symmetric(q: Float) -> Float:
    """(6,) lower triangle -> (3, 3) symmetric."""
    Q = np.zeros((3, 3))
    Q[_LOWER] = q
    return Q + Q.T - np.diag(np.diag(Q))


def constraint_system(A: Float) -> Float:
    """The rows that say "orthogonal and of equal length", (2 M, 6), right-hand side zero."""
    a, b = A[:, 0], A[:, 1]
    equal = (quadratic_form(a, a) - quadratic_form(b, b)) / 2.0
    return np.concatenate([equal, quadratic_form(a, b)])


def scale_system(A: Float) -> Float:
    """The rows whose value is the squared magnification of each image, (M, 6)."""
    return (quadratic_form(A[:, 0], A[:, 0]) + quadratic_form(A[:, 1], A[:, 1])) / 2.0


def linear_upgrade(A: Float, scale_sigma: float) -> tuple[Float, Float]:
    """The least-squares Q (3, 3), not necessarily definite, and the singular values of the system.

    Magnifications enter as ``s^2 = 1 +- 2 scale_sigma`` against an orthogonality of the accuracy
    of the cameras (taken as 1e-3 relative).
    """
    hard = constraint_system(A)
    weight = min(1.0, 1e-3 / max(scale_sigma, 1e-12))
    soft = weight * scale_system(A)
    system = np.concatenate([hard, soft])
    rhs = np.concatenate([np.zeros(len(hard)), np.full(len(soft), weight)])
    q, *_ = np.linalg.lstsq(system, rhs, rcond=None)
    singular = np.linalg.svd(np.concatenate([hard, scale_system(A)]), compute_uv=False)
    return symmetric(q), singular


def _lower(params: Float) -> Float:
    L = np.zeros((3, 3))
    L[_LOWER] = params
    # beyond e^30 a start has run away; the bound keeps the arithmetic finite
    L[np.arange(3), np.arange(3)] = np.exp(np.clip(np.diag(L), -30.0, 30.0))
    return L


def _params(L: Float) -> Float:
    P = L.copy()
    P[np.arange(3), np.arange(3)] = np.log(np.diag(L))
    return np.asarray(P[_LOWER])


def refine_upgrade(
    A: Float, L: Float, scale_sigma: float, camera_sigma: float
) -> tuple[Float, float]:
    """Refine L (lower triangular, positive diagonal) on all constraints; returns (L, cost).

    Residuals: rows of equal length and orthogonal up to `camera_sigma`, log magnification zero up
    to `scale_sigma`, both with a Cauchy loss so that a few bad cameras do not bend the metric.
    """

    def residuals(params: Float) -> Float:
        B = A @ _lower(params)
        a, b = B[:, 0], B[:, 1]
        aa, bb, ab = np.sum(a * a, 1), np.sum(b * b, 1), np.sum(a * b, 1)
        mean = (aa + bb) / 2.0
        log_scale = 0.5 * np.log(np.maximum(mean, 1e-300))
        shape = np.concatenate([(aa - bb) / (2.0 * mean), ab / mean]) / camera_sigma
        return np.concatenate([shape, log_scale / scale_sigma])

    result = least_squares(
        residuals, _params(L), method="trf", loss="cauchy", f_scale=3.0, x_scale="jac"
    )
    return _lower(result.x), float(result.cost)


def positive_definite_start(Q: Float) -> tuple[Float, bool]:
    """Cholesky factor of Q, moved inside the cone when it is not definite, and whether it was."""
    values, vectors = np.linalg.eigh(Q)
    floor = 1e-2 * max(values[-1], 1e-300)
    indefinite = bool(values[0] < 1e-6 * values[-1])
    Q = vectors @ np.diag(np.maximum(values, floor if indefinite else values[0])) @ vectors.T
    return np.asarray(np.linalg.cholesky(Q), dtype=np.float64), indefinite


@dataclass(frozen=True, kw_only=True, eq=False)
class Upgraded:
    """A Euclidean model, up to the hand."""

    cameras: OrthographicCameras
    points: Float
    """(N, 3)"""
    figures: UpgradeFigures


def upgrade_to_euclidean(
    model: AffineModel, *, scale_sigma: float, camera_sigma: float = 1e-3
) -> Solution[Upgraded]:
    """Orthographic cameras and Euclidean points from an affine model.

    Parameters
    ----------
    model : cameras up to an affinity
    scale_sigma : relative spread of the magnification between images
    camera_sigma : relative accuracy of the affine cameras

    Returns
    -------
    Solution of Upgraded; the first image's axes are the world's, the mean
    magnification is 1 px per unit, the hand is one of the two possible.
    Status "underdetermined" when more than nothing is left free by the views.

    """
    A = np.asarray(model.A)
    norm = np.sqrt(np.mean(A * A))
    A = A / norm
    Q, singular = linear_upgrade(A, scale_sigma)
    num_free = int(np.sum(singular < MIN_RELATIVE_SINGULAR_VALUE * singular[0]))
    L0, indefinite = positive_definite_start(Q)
    starts = [L0]
    if indefinite:
        # the depth direction is the weak one: start it flat, medium and deep as well
        values, vectors = np.linalg.eigh(Q)
        for depth in (0.05, 0.3, 1.0):
            spectrum = np.array([depth, 1.0, 1.0]) * values[-1]
            starts.append(np.linalg.cholesky(vectors @ np.diag(spectrum) @ vectors.T))
    fits = [refine_upgrade(A, L, scale_sigma, camera_sigma) for L in starts]
    L, cost = min(fits, key=lambda fit: fit[1])
    B = A @ L
    lengths = np.sqrt(np.sum(B * B, axis=(1, 2)) / 2.0)
    third = np.cross(B[:, 0], B[:, 1]) / lengths[:, None]
    R = nearest_rotation(np.concatenate([B, third[:, None]], axis=1))
    common = float(np.exp(np.mean(np.log(lengths))))
    R0 = R[0]
    cameras = OrthographicCameras(
        cam_from_world=R @ R0.T,
        scale_px_per_unit=lengths / common,
        translation_px=np.array(model.t),
    )
    # A X = (A_hat norm) X = B (L^-1 norm X) with B = lengths * R[:2]
    points = np.linalg.solve(L, np.asarray(model.X).T * norm).T * common
    points = points @ R0.T
    if num_free > 0:
        return Solution(
            value=None,
            status="underdetermined",
            message=f"the views leave {num_free} direction(s) of the metric free: at least three "
            "views that differ by more than an in-plane rotation or a shift are needed",
            diagnostics={"singular_values": singular.tolist(), "num_free": num_free},
        )
    figures = UpgradeFigures(
        singular_values=tuple(singular.tolist()),
        num_free=num_free,
        indefinite=indefinite,
        cost=cost,
    )
    return Solution(
        value=Upgraded(cameras=cameras, points=points, figures=figures),
        status="indefinite_start" if indefinite else "ok",
        message="the linear upgrade was not positive definite; the refined one is"
        if indefinite
        else "",
    )
