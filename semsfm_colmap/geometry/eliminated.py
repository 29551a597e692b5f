"""Least squares over cameras with the points eliminated exactly.

The cost is ``sum_o rho(|r_o|^2 / sigma^2) + |prior(c)|^2``, ``r_o = A_i(c) X_j + t_i(c) - xy_o``.
For given cameras the points are linear (`points.solve_points`), so the search runs over the camera
parameters alone: variable projection (Golub and Pereyra 1973) with Kaufman's approximation of the
Jacobian, which is the Schur complement of bundle adjustment evaluated at the optimal points. Each
Levenberg-Marquardt step solves the dense reduced system

    S = sum_j [ J_a^T J_a - (J_a^T P_a) (sum P^T P)^-1 (P_b^T J_b) ]_{ab in j}

of size (number of camera parameters)^2; the damping acts on the cameras only, never on the points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numba
import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse.linalg import splu
from threadpoolctl import threadpool_limits

from semsfm_colmap.geometry.losses import LossName, loss, weight
from semsfm_colmap.geometry.points import (
    add_observation,
    invert_symmetric,
    residuals,
    solve_points,
    track_pointer,
)
from semsfm_colmap.types import Float, Int, Observations

P = TypeVar("P")

SPARSE_LIMIT = 1500
"""Larger systems are tried as sparse ones."""
MAX_SPARSE_DENSITY = 0.15
"""Share of non-zeros up to which the sparse factorization is faster."""
SINGLE_THREAD_LIMIT = 1500
"""Up to so many parameters one BLAS thread is fastest."""
DENSE_CHUNK_LIMIT = 3000
"""Above so many parameters the reduced system is accumulated in 2 copies, below in 4."""


class CameraModel(Protocol[P]):
    """What the solver needs to know of a camera parametrisation with p parameters an image."""

    @property
    def param_idx(self) -> Int:
        """(M, p): where each local parameter stands in the global vector; -1 is held fixed."""
        ...

    @property
    def num_params(self) -> int:
        """Length of the global vector."""
        ...

    def cameras(self, params: P) -> tuple[Float, Float]:
        """The affine cameras A (M, 2, 3), t (M, 2)."""
        ...

    def jacobian(self, params: P, X: Float, image_idx: Int, track_idx: Int) -> Float:
        """(O, 2, p): derivative of each prediction by its image's local parameters."""
        ...

    def retract(self, params: P, step: Float) -> P:
        """The parameters after a step of the global vector."""
        ...

    def prior(self, params: P) -> tuple[Float, sparse.csr_array]:
        """Prior residuals (K,), in units of their sigma, and their Jacobian (K, num_params)."""
        ...


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """Levenberg-Marquardt settings."""

    max_iterations: int = 100
    """Give up after so many steps."""
    cost_tolerance: float = 1e-10
    """Converged when an accepted step lowers the cost by less than this share."""
    absolute_tolerance: float = 0.0
    """Converged when an accepted step lowers the cost by less than this. With the true noise as
    unit the cost is a chi square: a fall by d moves no parameter by more than sqrt(d) sigma."""
    gradient_tolerance: float = 1e-12
    """Converged when the gradient, scaled by the Hessian's diagonal, falls below this."""
    initial_damping: float = 1e-4
    """First damping, relative to the diagonal of the reduced Hessian."""
    loss: LossName = "squared"
    """Loss of the residual norm."""
    loss_width: float = 2.0
    """Where the loss bends, in units of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Eliminated(Generic[P]):
    """A state of the search: camera parameters with their optimal points."""

    params: P
    X: Float
    residuals: Float
    weight: Float
    cost: float
    costs: tuple[float, ...] = ()
    iterations: int = 0
    converged: bool = False


@numba.njit(cache=True, parallel=True)
def _accumulate(J, A, r, w, image_idx, pointer, param_idx, chunk, L, g, max_len):  # type: ignore[no-untyped-def]
    p = J.shape[2]
    for c in numba.prange(len(chunk) - 1):
        E = np.zeros((max_len, p, 3))
        F = np.zeros((p, 3))
        H = np.zeros((3, 3))
        Hinv = np.zeros((3, 3))
        b = np.zeros(3)
        for j in range(chunk[c], chunk[c + 1]):
            begin, end = pointer[j], pointer[j + 1]
            H[:] = 0.0
            b[:] = 0.0
            for o in range(begin, end):
                add_observation(H, b, A[image_idx[o]], r[o, 0], r[o, 1], w[o])
            if not invert_symmetric(H, Hinv):
                continue
            for o in range(begin, end):
                i = image_idx[o]
                a = o - begin
                for k in range(p):
                    j0, j1 = w[o] * J[o, 0, k], w[o] * J[o, 1, k]
                    for m in range(3):
                        E[a, k, m] = j0 * A[i, 0, m] + j1 * A[i, 1, m]
                    for m in range(3):
                        F[k, m] = (
                            E[a, k, 0] * Hinv[0, m]
                            + E[a, k, 1] * Hinv[1, m]
                            + E[a, k, 2] * Hinv[2, m]
                        )
                for k in range(p):
                    gk = param_idx[i, k]
                    if gk < 0:
                        continue
                    j0, j1 = w[o] * J[o, 0, k], w[o] * J[o, 1, k]
                    g[c, gk] += (
                        j0 * r[o, 0]
                        + j1 * r[o, 1]
                        - (F[k, 0] * b[0] + F[k, 1] * b[1] + F[k, 2] * b[2])
                    )
                    # L + L^T is the Hessian, so the diagonal block enters with one half
                    for m in range(p):
                        gm = param_idx[i, m]
                        if gm >= 0:
                            L[c, gk, gm] += 0.5 * (
                                j0 * J[o, 0, m]
                                + j1 * J[o, 1, m]
                                - F[k, 0] * E[a, m, 0]
                                - F[k, 1] * E[a, m, 1]
                                - F[k, 2] * E[a, m, 2]
                            )
                    for other in range(a):
                        i2 = image_idx[begin + other]
                        for m in range(p):
                            gm = param_idx[i2, m]
                            if gm >= 0:
                                L[c, gk, gm] -= (
                                    F[k, 0] * E[other, m, 0]
                                    + F[k, 1] * E[other, m, 1]
                                    + F[k, 2] * E[other, m, 2]
                                )


def reduced_system(
    J: Float,
    A: Float,
    r: Float,
    w: Float,
    image_idx: Int,
    pointer: Int,
    param_idx: Int,
    num_params: int,
) -> tuple[Float, Float]:
    """The reduced Gauss-Newton Hessian (n, n) and gradient (n,) of the camera parameters.

    Accumulated in a number of chunks that depends on the problem only, so that the sums, and with
    them the result, are the same for any number of threads.
    """
    num_tracks = len(pointer) - 1
    num_chunks = 4 if num_params < DENSE_CHUNK_LIMIT else 2
    # equal shares of observations
    targets = np.linspace(0, pointer[-1], num_chunks + 1)
    chunk = np.searchsorted(pointer, targets).astype(np.int64)
    chunk[0], chunk[-1] = 0, num_tracks
    L = np.zeros((num_chunks, num_params, num_params))
    g = np.zeros((num_chunks, num_params))
    max_len = int(np.max(np.diff(pointer), initial=1))
    _accumulate(J, A, r, w, image_idx, pointer, param_idx, chunk, L, g, max_len)
    H = L[0]
    for other in L[1:]:
        H += other
    return H + H.T, g.sum(axis=0)


def solve_damped(H: Float, damping: Float, g: Float) -> Float:
    """Solve ``(H + diag(damping)) x = g`` for a positive definite H (n, n).

    Dense Cholesky; a large H with few entries, as long series with short tracks have, is factorized
    as a sparse matrix.
    """
    n = len(g)
    if n > SPARSE_LIMIT:
        A = sparse.csc_array(H)
        if A.nnz < MAX_SPARSE_DENSITY * n * n:
            A = sparse.csc_array(A + sparse.diags_array(damping, format="csc"))
            factor = splu(A, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            x = np.asarray(factor.solve(g))
            if not np.isfinite(x).all():
                raise LinAlgError("the damped system is singular")
            return x
    damped = H.copy()
    damped[np.diag_indices_from(damped)] += damping
    return np.asarray(cho_solve(cho_factor(damped, lower=True, overwrite_a=True), g))


def evaluate(
    model: CameraModel[P],
    params: P,
    observations: Observations,
    pointer: Int,
    sigma_px: float,
    options: SolverOptions,
    start_weight: Float,
) -> Eliminated[P]:
    """Cameras -> optimal points, residuals, robust weights and cost."""
    obs = observations
    A, t = model.cameras(params)
    robust = options.loss != "squared"
    w = start_weight
    # with a robust loss the points are reweighted twice: enough, the outer loop goes on
    for _ in range(3 if robust else 1):
        X = np.nan_to_num(solve_points(A, t, obs.image_idx, pointer, obs.xy, w))
        r = residuals(A, t, X, obs.image_idx, obs.track_idx, obs.xy)
        s = np.einsum("od,od->o", r, r) / sigma_px**2
        w = weight(options.loss, s, options.loss_width)
    prior, _ = model.prior(params)
    cost = float(np.sum(loss(options.loss, s, options.loss_width)) + prior @ prior)
    return Eliminated(params=params, X=X, residuals=r, weight=w, cost=cost)


def linearise(
    model: CameraModel[P],
    state: Eliminated[P],
    observations: Observations,
    pointer: Int,
    sigma_px: float,
) -> tuple[Float, Float]:
    """Hessian and gradient of half the cost at a state, priors included."""
    obs = observations
    A, _ = model.cameras(state.params)
    J = model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    w = state.weight / sigma_px**2
    H, g = reduced_system(
        J, A, state.residuals, w, obs.image_idx, pointer, model.param_idx, model.num_params
    )
    prior, prior_jacobian = model.prior(state.params)
    if len(prior):
        H += sparse.csr_array(prior_jacobian.T @ prior_jacobian).toarray()
        g += np.asarray(prior_jacobian.T @ prior)
    return H, g


def minimise(
    model: CameraModel[P],
    params: P,
    observations: Observations,
    *,
    sigma_px: float = 1.0,
    options: SolverOptions | None = None,
) -> Eliminated[P]:
    """Levenberg-Marquardt from `params`; the cost never rises (Nielsen's damping update).

    Observations must be sorted by track. Tracks whose rays do not fix a point have no say.
    """
    # the reduced systems are small: more BLAS threads only wait for one another
    threads = 1 if model.num_params < SINGLE_THREAD_LIMIT else None
    with threadpool_limits(limits=threads, user_api="blas"):
        return _minimise(model, params, observations, sigma_px, options or SolverOptions())


def _minimise(
    model: CameraModel[P],
    params: P,
    observations: Observations,
    sigma_px: float,
    options: SolverOptions,
) -> Eliminated[P]:
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    ones = np.ones(len(observations))
    state: Eliminated[Any] = evaluate(model, params, observations, pointer, sigma_px, options, ones)
    costs = [state.cost]
    damping, growth = options.initial_damping, 2.0
    converged = False
    iteration = 0
    H, g = linearise(model, state, observations, pointer, sigma_px)
    while iteration < options.max_iterations and not converged:
        iteration += 1
        diagonal = np.diag(H).copy()
        floor = 1e-12 * float(np.max(diagonal, initial=1e-300))
        diagonal = np.maximum(diagonal, floor)
        if np.max(np.abs(g) / np.sqrt(diagonal), initial=0.0) < options.gradient_tolerance * (
            1.0 + np.sqrt(state.cost)
        ):
            converged = True
            break
        try:
            step = -solve_damped(H, damping * diagonal, g)
        except LinAlgError:
            damping, growth = damping * growth, growth * 2.0
            continue
        trial = evaluate(
            model,
            model.retract(state.params, step),
            observations,
            pointer,
            sigma_px,
            options,
            state.weight,
        )
        predicted = float(-2.0 * (g @ step) - step @ (H @ step))
        gain = (state.cost - trial.cost) / max(predicted, 1e-300)
        if trial.cost < state.cost:
            fall = state.cost - trial.cost
            converged = fall <= max(options.cost_tolerance * state.cost, options.absolute_tolerance)
            state = trial
            costs.append(state.cost)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            damping = max(damping, 1e-12)
            growth = 2.0
            if not converged:
                H, g = linearise(model, state, observations, pointer, sigma_px)
        else:
            # a step too small to change the cost in double precision is as good as none
            if predicted <= options.cost_tolerance * state.cost * 1e-2 or damping > 1e12:
                converged = True
            damping, growth = damping * growth, growth * 2.0
    return replace(state, costs=tuple(costs), iterations=iteration, converged=converged)
