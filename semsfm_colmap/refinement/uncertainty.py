"""Error bars that hold: noise, what neighbours err in together, and what all err in together.

The covariance of a bundle adjustment takes every observation for an independent one. They are not:
neighbours share relief, shading and blur, and some errors are common to the whole series. A small
set of *modes* says so. A mode is a vector of the camera parameters, one standard deviation of an
independent error; the points follow the cameras. With C the formal covariance (`covariance`) and m
the modes, any function with derivative d has the variance

    d^T C d + sum_m (d . m)^2,

and its parts keep their names:

*noise*: C, independent noise of every observation.

*clustered*: the surface is cut into K patches (k-means of the points). Observation o pulls the
cameras by ``-C J_o^T w_o r_o`` (at their optimal points the residuals of a track leave nothing
else). If errors are correlated within patches but not between them, the sums over each patch are
independent samples, and as modes add up to the cluster-robust (sandwich) covariance [Liang and
Zeger 1986; K / (K - 1) for the mean that the fit has taken off].

*drag*: what is left of the drag (`drag`), whose coefficient is a law for an average specimen. The
mode of a shared parameter is the movement of all others with it, ``C e_c / C_cc``.

*shading*: other fields by which shading may displace observations q(n); their modes are the
response of the adjustment to them, ``-C J^T w (q - A X_q)`` with X_q the points that suit q best.

*models*: what the rungs of the ladder that the images do not rule out disagree on (`model_spread`).

Points have one more part of their own, *relief*, along their normals (`relief_sigma`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated, precision_of
from semsfm_colmap.geometry.normals import nearest_neighbors
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.covariance import CameraCovariance, Covariance
from semsfm_colmap.refinement.uncertainty_kernels import add_pull, fill_point_modes
from semsfm_colmap.types import Float, Int, Observations

NUM_PATCHES = 100
"""Patches of the surface: small enough to be many, large against what neighbours share."""
MIN_PATCH_POINTS = 8
"""Points that a patch holds at least, on the average."""
RELIEF_PX = 1.1
"""Standard deviation of a point along its normal on a smooth surface: where in the relief under its
window it lies."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Covariance of cameras and points, in parts."""

    noise: Covariance
    """Formal: of independent noise"""
    total: Covariance
    """Standard deviations and points with everything in them; `cameras` is the formal part"""
    modes: Mapping[str, Float] = field(default_factory=dict)
    """For each name vectors (n, k) of the camera parameters, each a standard deviation"""
    relief_px: float = 0.0
    """Of each point by itself, along its normal"""
    notes: tuple[str, ...] = ()
    """What the error bars take into account that is not usual"""

    def parts(self, direction: Float) -> dict[str, float]:
        """Standard deviation of a combination (n,) of the camera parameters, by cause."""
        found = {"noise": float(np.sqrt(self.noise.cameras.variance(direction)))}
        for name, modes in self.modes.items():
            found[name] = float(np.linalg.norm(direction @ modes))
        return found

    def sigma(self, direction: Float) -> float:
        """Standard deviation of a combination (n,) of the camera parameters."""
        return float(np.sqrt(sum(part**2 for part in self.parts(direction).values())))


def grouped_pull(J: Float, r: Float, w: Float, param_idx: Int, image_idx: Int, group: Int) -> Float:
    """``sum_o J_o^T w_o r_o`` over the observations of each group: (n, K), n parameters."""
    by_image = np.zeros((*param_idx.shape, int(group.max(initial=0)) + 1))
    add_pull(J, r, w, image_idx, group, by_image)
    out = np.zeros((int(param_idx.max()) + 1, by_image.shape[2]))
    used = param_idx >= 0
    np.add.at(out, param_idx[used], by_image[used])
    return out


def apply_covariance(cameras: CameraCovariance, g: Float) -> Float:
    """``C g`` for g (n,) or (n, k)."""
    N = cameras.gauge
    z = cameras.factor.solve(g - N @ (N.T @ g))
    return np.asarray(z - N @ (N.T @ z))


def surface_patches(points: Float, num_patches: int = NUM_PATCHES, seed: int = 0) -> Int:
    """Cut points (N, 3) into patches of neighbours: (N,) numbers of the patch."""
    from scipy.cluster.vq import kmeans2

    wanted = int(np.clip(len(points) // MIN_PATCH_POINTS, 2, num_patches))
    rng = np.random.default_rng(seed)
    _, label = kmeans2(points, wanted, iter=12, minit="points", seed=rng, missing="warn")
    return np.asarray(np.unique(label, return_inverse=True)[1], dtype=np.int64)


def clustered_modes(
    model: PoseModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
    cameras: CameraCovariance,
    patch: Int,
) -> Float:
    """Modes (n, K) of what the patches pull the cameras by; `patch` (N,) of each track."""
    obs = observations
    J = model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    w = state.weight * precision_of(sigma_px, obs)
    pull = grouped_pull(J, state.residuals, w, model.param_idx, obs.image_idx, patch[obs.track_idx])
    K = pull.shape[1]
    return np.asarray(np.sqrt(K / max(K - 1.0, 1.0)) * apply_covariance(cameras, pull))


def shared_mode(cameras: CameraCovariance, index: int) -> tuple[Float, float]:
    """How all parameters (n,) move with a unit of parameter `index`, and its formal sigma."""
    e = np.zeros(len(cameras.gauge))
    e[index] = 1.0
    column = apply_covariance(cameras, e)
    return column / column[index], float(np.sqrt(column[index]))


def field_modes(
    model: PoseModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
    cameras: CameraCovariance,
    fields: Float,
) -> Float:
    """Modes (n, K): how the cameras move when the observations are displaced by fields (O, 2, K).

    With the points that suit the displaced observations best, what is left of a field pulls the
    cameras like any residual.
    """
    obs = observations
    A, _ = model.cameras(state.params)
    A = np.ascontiguousarray(A)
    w = precision_of(sigma_px, obs)
    J = model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    nowhere = np.zeros((len(A), 2))
    together = np.zeros(len(obs), dtype=np.int64)
    pulls = []
    for k in range(fields.shape[2]):
        q = np.ascontiguousarray(fields[:, :, k])
        X = np.nan_to_num(solve_points(A, nowhere, obs.image_idx, pointer, q, w))
        left = residuals(A, nowhere, X, obs.image_idx, obs.track_idx, q)
        pull = grouped_pull(J, left, w, model.param_idx, obs.image_idx, together)
        pulls.append(-pull[:, 0])
    return apply_covariance(cameras, np.stack(pulls, axis=1))


def point_modes(
    model: PoseModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
    modes: Float,
) -> Float:
    """How the points follow modes (n, K) of the cameras: (N, 3, K)."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    J = model.jacobian(state.params, state.X, obs.image_idx, obs.track_idx)
    A = np.ascontiguousarray(model.cameras(state.params)[0])
    padded = np.concatenate([modes, np.zeros((1, modes.shape[1]))])  # index -1 reads the zero
    out = np.empty((obs.num_tracks, 3, modes.shape[1]))
    with threads_for(len(J) * modes.shape[1]):
        fill_point_modes(
            J,
            A,
            precision_of(sigma_px, obs),
            obs.image_idx,
            pointer,
            np.ascontiguousarray(padded[model.param_idx]),
            out,
        )
    return out


def with_modes(
    found: Uncertainty,
    modes: Mapping[str, Float],
    model: PoseModel[Any],
    state: Eliminated[Any],
    observations: Observations,
    sigma_px: float,
) -> Uncertainty:
    """More modes, added to all that they widen."""
    together = np.concatenate(list(modes.values()), axis=1)
    padded = np.concatenate([together, np.zeros((1, together.shape[1]))])
    extra = np.sum(padded[model.param_idx] ** 2, axis=2)  # (M, p)
    moved = point_modes(model, state, observations, sigma_px, together)
    before = found.total
    total = replace(
        before,
        sigma_rotation_rad=np.sqrt(before.sigma_rotation_rad**2 + extra[:, :3]),
        sigma_translation_px=np.sqrt(before.sigma_translation_px**2 + extra[:, 4:6]),
        sigma_scale=np.sqrt(before.sigma_scale**2 + extra[:, 3]),
        points=before.points + moved @ moved.transpose(0, 2, 1),
    )
    return replace(found, total=total, modes={**found.modes, **modes})


def relief_sigma(points: Float, num_neighbors: int = 8) -> float:
    """Standard deviation of a point along its normal that no residual tells of, px.

    A patch has no single depth: where its point lies within the relief under the window is a matter
    of what the window happens to show. Against the true surface, points of rendered series lie off
    by RELIEF_PX, and by as much more as they scatter about planes through their neighbours.
    """
    if len(points) <= num_neighbors + 3:
        return RELIEF_PX
    _, idx = nearest_neighbors(points, num_neighbors)
    around = points[np.column_stack([np.arange(len(points)), idx])]
    around = around - around.mean(axis=1, keepdims=True)
    square = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", around, around))[:, 0]
    scatter = float(np.median(np.sqrt(np.maximum(square, 0.0) / (num_neighbors - 2))))
    return float(np.hypot(RELIEF_PX, scatter))


def with_relief(uncertainty: Uncertainty, normals: Float, sigma_px: float) -> Uncertainty:
    """The points' covariances with what they err in along their normals (N, 3), each by itself."""
    own = sigma_px**2 * np.einsum("ni,nj->nij", normals, normals)
    total = replace(uncertainty.total, points=uncertainty.total.points + own)
    return replace(uncertainty, total=total, relief_px=sigma_px)
