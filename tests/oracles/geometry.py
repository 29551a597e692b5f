"""Plain, slow references for the fast routines of the geometry."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from semsfm_colmap.types import Array, Float


def solve_point(A: Float, t: Float, xy: Float, weight: Float) -> Float:
    """One point by dense least squares: (L, 2, 3), (L, 2), (L, 2), (L,) -> (3,)."""
    root = np.repeat(np.sqrt(weight), 2)
    design = A.reshape(-1, 3) * root[:, None]
    return np.linalg.lstsq(design, (xy - t).ravel() * root, rcond=None)[0]


def reduced_system(
    J: Float, A: Float, r: Float, w: Float, image_idx: Array, track_idx: Array, param_idx: Array
) -> tuple[Float, Float]:
    """Schur complement of the full dense normal equations of cameras and points."""
    num_params = int(param_idx.max()) + 1
    num_tracks = int(track_idx.max()) + 1
    n = num_params + 3 * num_tracks
    full = np.zeros((2 * len(r), n))
    root = np.sqrt(w)
    for o in range(len(r)):
        rows = slice(2 * o, 2 * o + 2)
        for k, g in enumerate(param_idx[image_idx[o]]):
            if g >= 0:
                full[rows, g] += root[o] * J[o, :, k]
        j = num_params + 3 * track_idx[o]
        full[rows, j : j + 3] = root[o] * A[image_idx[o]]
    b = (r * root[:, None]).ravel()
    H, g = full.T @ full, full.T @ b
    C, P = slice(0, num_params), slice(num_params, n)
    inverse = np.linalg.inv(H[P, P])
    return H[C, C] - H[C, P] @ inverse @ H[P, C], g[C] - H[C, P] @ inverse @ g[P]


def best_support(A: Float, t: Float, xy: Float, threshold_px: float) -> int:
    """Most observations that any pair of views of a track can gather: exhaustive."""
    best = 0
    for pair in combinations(range(len(xy)), 2):
        rows = list(pair)
        X = solve_point(A[rows], t[rows], xy[rows], np.ones(2))
        error = np.linalg.norm(A @ X + t - xy, axis=1)
        best = max(best, int(np.sum(error < threshold_px)))
    return best


def numeric_jacobian(f: object, x: Float, step: float = 1e-6) -> Float:
    """Central differences of ``f(x)``: (...,) by (n,) -> (..., n)."""
    columns = []
    for k in range(len(x)):
        d = np.zeros_like(x)
        d[k] = step
        columns.append((f(x + d) - f(x - d)) / (2 * step))  # type: ignore[operator]
    return np.stack(columns, axis=-1)


def covariance(model, state, observations, sigma_px):  # type: ignore[no-untyped-def]
    """Covariance of the cameras (n, n) and points (N, 3, 3) from the whole information matrix.

    The pseudo-inverse over the six directions in which the world turns and shifts.
    """
    obs = observations
    n, N = model.num_params, obs.num_tracks
    A, _ = model.cameras(state.params)
    J = np.zeros((2 * len(obs), n + 1 + 3 * N))
    local = model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    for o in range(len(obs)):
        i, j = obs.image_idx[o], obs.track_idx[o]
        J[2 * o : 2 * o + 2, model.param_idx[i]] += local[o]
        J[2 * o : 2 * o + 2, n + 1 + 3 * j : n + 4 + 3 * j] = A[i]
    J = np.delete(J, n, axis=1) / sigma_px
    prior = model.prior(state.params)[1].toarray()
    F = J.T @ J
    F[:n, :n] += prior.T @ prior
    E = F[:n, n:].reshape(n, N, 3)
    inverse = np.stack([np.linalg.inv(F[k : k + 3, k : k + 3]) for k in range(n, n + 3 * N, 3)])
    S = F[:n, :n] - np.einsum("njx,jxy,mjy->nm", E, inverse, E)
    values, vectors = np.linalg.eigh(S)
    C = (vectors[:, 6:] / values[6:]) @ vectors[:, 6:].T
    spread = np.einsum("njx,nm,mjy->jxy", E, C, E, optimize=True)
    return C, inverse + inverse @ spread @ inverse
