"""Least squares over cameras with the points eliminated exactly.

The cost is ``sum_o rho(|r_o|^2 / sigma_o^2) + |prior(c)|^2``, ``r_o = A_i(c) X_j + t_i(c) - xy_o``,
with ``sigma_o`` the noise times the observation's relative sigma.
For given cameras the points are linear (`points.solve_points`), so the search runs over the camera
parameters alone: variable projection (Golub and Pereyra 1973) with Kaufman's approximation of the
Jacobian, which is the Schur complement of bundle adjustment evaluated at the optimal points. Each
Levenberg-Marquardt step solves the reduced system of `geometry.reduced`, of size (number of camera
parameters)^2; the damping acts on the cameras only, never on the points.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgError

from semsfm_colmap.geometry.band import BandLayout, BandMatrix
from semsfm_colmap.geometry.losses import LossName, gaussian_constants
from semsfm_colmap.geometry.points import fit_points, track_pointer
from semsfm_colmap.geometry.reduced import (
    CovisiblePairs,
    accumulate_blocks,
    band_layout,
    covisible_pairs,
    gradient_of,
)
from semsfm_colmap.geometry.threads import blas_threads
from semsfm_colmap.types import Float, Int, Observations

P = TypeVar("P")

SINGLE_THREAD_WIDTH = 500
"""Up to a band of so many parameters one BLAS thread is fastest."""


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


@runtime_checkable
class Displacing(Protocol):
    """A camera model that shows some observations beside the place of an affine camera."""

    def displacement(self, params: Any, image_idx: Int, track_idx: Int) -> Float:
        """(O, 2) px, added to ``A X + t``."""
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
    """Loss of the residual norm, times its gain (see `losses.GaussianConstants`), so that it keeps
    the right weight against the priors."""
    loss_width: float = 2.0
    """Where the loss bends, in units of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Eliminated(Generic[P]):
    """A state of the search: camera parameters with their optimal points."""

    params: P
    X: Float
    residuals: Float
    weight: Float
    """(O,) slope of the loss"""
    cost: float
    options: SolverOptions = field(default_factory=SolverOptions)
    costs: tuple[float, ...] = ()
    iterations: int = 0
    converged: bool = False


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
    xy = obs.xy
    if isinstance(model, Displacing):
        xy = xy - model.displacement(params, obs.image_idx, obs.track_idx)
    X, r, w, cost = fit_points(
        np.ascontiguousarray(A),
        np.ascontiguousarray(t),
        obs.image_idx,
        pointer,
        xy,
        precision_of(sigma_px, obs),
        start_weight,
        loss=options.loss,
        loss_width=options.loss_width,
        # with a robust loss the points are reweighted twice: enough, the outer loop goes on
        rounds=1 if options.loss == "squared" else 3,
    )
    gain = gaussian_constants(options.loss, options.loss_width).gain
    w *= gain
    prior, _ = model.prior(params)
    cost = gain * cost + float(prior @ prior)
    return Eliminated(params=params, X=X, residuals=r, weight=w, cost=cost, options=options)


def precision_of(sigma_px: float, observations: Observations) -> Float:
    """One over the variance of each observation's coordinates: (O,) px^-2."""
    return np.asarray(observations.precision / sigma_px**2)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedSystem:
    """Which images meet in the reduced system, and how it is laid out; fixed during a search."""

    pairs: CovisiblePairs
    layout: BandLayout

    @classmethod
    def of(
        cls, model: CameraModel[P], params: P, observations: Observations, pointer: Int
    ) -> ReducedSystem:
        """From the tracks, the parameters and the priors."""
        pairs = covisible_pairs(observations.image_idx, pointer, observations.num_images)
        _, prior_jacobian = model.prior(params)
        layout = band_layout(pairs, model.param_idx, model.num_params, prior_jacobian)
        return cls(pairs=pairs, layout=layout)


def linearise(
    model: CameraModel[P],
    state: Eliminated[P],
    observations: Observations,
    pointer: Int,
    sigma_px: float,
    system: ReducedSystem,
) -> tuple[BandMatrix, Float]:
    """Hessian and gradient of half the cost at a state, priors included."""
    obs, pairs = observations, system.pairs
    A, _ = model.cameras(state.params)
    blocks, by_image = accumulate_blocks(
        lambda rows: model.jacobian(
            state.params, state.X, obs.image_idx[rows], obs.track_idx[rows]
        ),
        np.ascontiguousarray(A),
        state.residuals,
        state.weight * precision_of(sigma_px, obs),
        obs.image_idx,
        pointer,
        pairs,
        model.param_idx.shape[1],
    )
    H = BandMatrix.zeros(system.layout)
    H.add_blocks(blocks, pairs.first, pairs.second, model.param_idx)
    g = gradient_of(by_image, model.param_idx, model.num_params)
    prior, prior_jacobian = model.prior(state.params)
    H.add_products(prior_jacobian)
    return H, g + np.asarray(prior_jacobian.T @ prior)


def minimise(
    model: CameraModel[P],
    params: P,
    observations: Observations,
    *,
    sigma_px: float = 1.0,
    options: SolverOptions | None = None,
) -> Eliminated[P]:
    """Levenberg-Marquardt from `params`; the cost never rises (Nielsen's damping update).

    Observations must be sorted by track, then image. Tracks whose rays do not fix a point have no
    say. ``sigma_px`` is the noise of a coordinate, in which ``relative_sigma`` of an observation
    counts.
    """
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    system = ReducedSystem.of(model, params, observations, pointer)
    # a narrow band: more BLAS threads only wait for one another
    with blas_threads(1 if system.layout.width < SINGLE_THREAD_WIDTH else None):
        return _minimise(
            model, params, observations, pointer, system, sigma_px, options or SolverOptions()
        )


def _minimise(
    model: CameraModel[P],
    params: P,
    observations: Observations,
    pointer: Int,
    system: ReducedSystem,
    sigma_px: float,
    options: SolverOptions,
) -> Eliminated[P]:
    state: Eliminated[Any] = evaluate(
        model, params, observations, pointer, sigma_px, options, np.ones(len(observations))
    )
    costs = [state.cost]
    damping, growth = options.initial_damping, 2.0
    converged = False
    iteration = 0
    H, g = linearise(model, state, observations, pointer, sigma_px, system)
    while iteration < options.max_iterations and not converged:
        iteration += 1
        diagonal = H.main_diagonal()
        floor = 1e-12 * float(np.max(diagonal, initial=1e-300))
        diagonal = np.maximum(diagonal, floor)
        if np.max(np.abs(g) / np.sqrt(diagonal), initial=0.0) < options.gradient_tolerance * (
            1.0 + np.sqrt(state.cost)
        ):
            converged = True
            break
        try:
            step = -H.factorise(damping * diagonal).solve(g)
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
        # -2 g s - s H s with H s = -g - damping s
        predicted = float(damping * (step @ (diagonal * step)) - g @ step)
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
                H, g = linearise(model, state, observations, pointer, sigma_px, system)
        else:
            # a step too small to change the cost in double precision is as good as none
            if predicted <= options.cost_tolerance * state.cost * 1e-2 or damping > 1e12:
                converged = True
            damping, growth = damping * growth, growth * 2.0
    return replace(state, costs=tuple(costs), iterations=iteration, converged=converged)
