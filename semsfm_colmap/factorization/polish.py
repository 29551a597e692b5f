"""Affine polish: all cameras and points of the affine problem, by variable projection.

Minimises ``sum |A_i X_j + t_i - xy|^2`` over everything, translations included, from the CBC
start; the points are eliminated (`geometry.eliminated`). From CBC this reaches the best known
optimum of the published data sets [Hong et al., ECCV 2016].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from semsfm_colmap.geometry.eliminated import SolverOptions, minimise
from semsfm_colmap.types import AffineModel, Float, Int, Observations, Solution

AffineParams = tuple[Float, Float]


@dataclass(frozen=True, kw_only=True, eq=False)
class AffineCameraModel:
    """Eight parameters an image: the six of A in row-major order, then t."""

    param_idx: Int
    num_params: int

    @classmethod
    def free(cls, num_images: int) -> AffineCameraModel:
        """A model in which every camera may move."""
        n = 8 * num_images
        return cls(param_idx=np.arange(n, dtype=np.int64).reshape(num_images, 8), num_params=n)

    def cameras(self, params: AffineParams) -> tuple[Float, Float]:
        """The parameters are the cameras."""
        return params

    def jacobian(self, params: AffineParams, X: Float, image_idx: Int, track_idx: Int) -> Float:
        """``d(A X + t)``: X in each row of A, one for t."""
        J = np.zeros((len(image_idx), 2, 8))
        J[:, 0, 0:3] = J[:, 1, 3:6] = X[track_idx]
        J[:, 0, 6] = J[:, 1, 7] = 1.0
        return J

    def retract(self, params: AffineParams, step: Float) -> AffineParams:
        """Plain addition."""
        A, t = params
        delta = step.reshape(len(t), 8)
        return A + delta[:, :6].reshape(-1, 2, 3), t + delta[:, 6:]

    def prior(self, params: AffineParams) -> tuple[Float, sparse.csr_array]:
        """No prior: the affinity is free."""
        return np.zeros(0), sparse.csr_array((0, self.num_params))


def normalise_gauge(A: Float, t: Float, X: Float) -> AffineModel:
    """Move the affine gauge so that X is centred and white: the best conditioned choice.

    ``A X + t`` stays the same for every camera and point.
    """
    good = np.all(np.isfinite(X), axis=1)
    centre = X[good].mean(axis=0)
    covariance = np.cov((X[good] - centre).T)
    L = np.linalg.cholesky(covariance + 1e-15 * np.trace(covariance) * np.eye(3))
    t = t + A @ centre
    return AffineModel(A=A @ L, t=t, X=np.linalg.solve(L, (X - centre).T).T)


@dataclass(frozen=True, kw_only=True, eq=False)
class Polished:
    """An affine model at a minimum of the reprojection error."""

    model: AffineModel
    residuals: Float
    """(O, 2) px"""

    @property
    def rms_px(self) -> float:
        """Root mean square residual per coordinate."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def polish_affine(
    start: AffineModel,
    observations: Observations,
    *,
    solver: SolverOptions | None = None,
    sigma_px: float = 1.0,
) -> Solution[Polished]:
    """Refine cameras and points of an affine model to a minimum of the reprojection error.

    Parameters
    ----------
    start : its points are not used beyond choosing the gauge
    observations : sorted by track
    solver : loss, tolerances; by default squared loss
    sigma_px : unit of the robust loss

    Returns
    -------
    Solution of Polished; ``costs`` are sums of the loss

    """
    gauge = normalise_gauge(start.A, start.t, start.X)
    model = AffineCameraModel.free(len(gauge.t))
    end = minimise(
        model,
        (np.array(gauge.A), np.array(gauge.t)),
        observations,
        sigma_px=sigma_px,
        options=solver,
    )
    A, t = end.params
    return Solution(
        value=Polished(model=normalise_gauge(A, t, end.X), residuals=end.residuals),
        status="ok" if end.converged else "iteration_limit",
        message="" if end.converged else "the affine polish stopped before it converged",
        iterations=end.iterations,
        costs=end.costs,
    )
