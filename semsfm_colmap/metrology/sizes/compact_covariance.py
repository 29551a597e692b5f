"""The cameras' part of `metrology.sizes.covariance` in few numbers, for places that a page chooses.

A place follows the camera parameters m by ``dX = -H^-1 sum_i A_i^T J_i(X, n) dm``, the sum over the
images that see it (`mapping.joint_covariance`). A self-contained page cannot hold the joint
covariance S of all vertices of a mesh, and need not: with modes m_k such that ``S = sum_k m_k
m_k^T``, a value with gradients g_a by its places has

    var f = sum_k (sum_a g_a . dX_a(m_k))^2,    g . dX(m_k) = -sum_i (A_i H^-1 g) . q_ik(X, n),

where ``q_ik = J_i m_k`` is how mode k moves the image of the place. It is a polynomial in X and the
normal n: affine in X for rotations, shifts, magnifications and drift, quadratic in n for the drag,
which is nothing where n is turned away from the image. So the page needs A_i, the coefficients of
q_ik, and which images see each vertex.

The modes are chosen for differences of places, which is all that is measured. With D (P, n) the
directions of lengths between P pairs of places, each scaled to unit variance, ``K = D S D^T = Q L
Q^T`` and ``m_k = S D^T Q_k / sqrt(L_k)`` are the best r of them for those lengths (the columns of
an optimal Nystrom approximation, which never exceeds S). r is the least for which other pairs, near
and far, lose no more than 1 % of their variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from semsfm_colmap.types import Float, Int

MAX_LOSS = 0.01
"""Share of the variance of a length that may be left out: 0.5 % of its sigma."""
NUM_PLACES = 400
"""Vertices between which the lengths are tried: each with its neighbour and with a far one."""
NUM_SAMPLES = 60
"""Places at which the polynomials are fitted."""
MAX_MISFIT = 1e-6
"""Largest part of q that the polynomials may miss."""
AFFINE_IN_PLACE = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
SEED = 0


class ParameterCovariance(Protocol):
    """What `mapping.joint_covariance.JointCovariance` gives."""

    @property
    def num_params(self) -> int:
        """n, the camera parameters."""
        ...

    @property
    def px_per_unit(self) -> float:
        """Of the parameters' unit, px, to the world's."""
        ...

    @property
    def projection(self) -> Float:
        """(M, 2, 3) px per px."""
        ...

    @property
    def param_idx(self) -> Int:
        """(M, p) of each image's parameters, -1 for none."""
        ...

    def surface_direction(
        self, points: Float, normals: Float, weights: Float, gradient: Float
    ) -> Float:
        """Direction (n,) of the parameters for places that follow the images that see them."""
        ...

    def times(self, directions: Float) -> Float:
        """``S d`` for directions (n, P)."""
        ...

    def image_derivatives(self, points: Float, normals: Float, image: int) -> Float:
        """(K, 2, p) px, of the places' pixels in an image by its parameters."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class CompactCovariance:
    """The module's A_i and q_ik."""

    projection: Float
    """(M, 2, 3) px per world unit"""
    displacement: Float
    """(M, 2, B, r) px: coefficients of the B monomials for r modes"""
    exponents: Int
    """(B, 6) of x, y, z of the place, as below, and of its normal"""
    center: Float
    """(3,) of the places; the monomials are of ``(X - center) / radius``"""
    radius: float
    largest_loss: float
    """share of a length's variance that is left out"""


def compact_covariance(
    cameras: ParameterCovariance, points: Float, normals: Float, weights: Float, neighbors: Int
) -> CompactCovariance | None:
    """Modes and polynomials for places of a surface; None where these polynomials do not suit.

    Parameters
    ----------
    points, normals : (K, 3) places spread over the surface, with outward normals
    weights : (K, M) of the images that see each
    neighbors : (K,) another place near to each, by its number

    """
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = float(np.linalg.norm(points - center, axis=1).max()) or 1.0
    exponents, coefficients = _polynomials(cameras, points, normals, center, radius)
    if exponents is None or coefficients is None:
        return None
    modes, loss = _modes(cameras, points, normals, weights, neighbors)
    idx = cameras.param_idx
    padded = np.concatenate([modes, np.zeros((1, modes.shape[1]))])  # index -1 reads the zero
    return CompactCovariance(
        projection=cameras.projection * cameras.px_per_unit,
        displacement=np.einsum("ixbp,ipk->ixbk", coefficients, padded[idx]),
        exponents=exponents,
        center=center,
        radius=radius,
        largest_loss=loss,
    )


def monomials(points: Float, normals: Float, exponents: Int, center: Float, radius: float) -> Float:
    """(K, B) at places and their normals."""
    at = np.concatenate([(points - center) / radius, normals], axis=1)
    return np.asarray(np.prod(at[:, None] ** exponents[None], axis=2))


def _of_normal(degree: int) -> Int:
    """Monomials (B, 6) of unit normals that span the polynomials of a degree, constants included.

    Of ``x^2 + y^2 + z^2 = 1`` higher powers of z follow; z^2 itself stands for the constant.
    """
    powers = [
        (a, b, c)
        for a in range(degree + 1)
        for b in range(degree + 1 - a)
        for c in range(2)
        if 0 < a + b + c <= degree
    ]
    return np.array([(0, 0, 0, *e) for e in (*powers, (0, 0, 2))], dtype=np.int64)


def _polynomials(
    cameras: ParameterCovariance, points: Float, normals: Float, center: Float, radius: float
) -> tuple[Int | None, Float | None]:
    """Exponents (B, 6) and coefficients (M, 2, B, p) of the derivatives of each image.

    What a place turned away has is affine in X; what the normal of one that faces the image adds is
    a polynomial of the normal, of the 2nd degree for the drag, else tried up to the 4th.
    """
    some = np.linspace(0, len(points) - 1, min(NUM_SAMPLES, len(points))).astype(np.int64)
    X = points[some]
    of_place = np.array([(*e, 0, 0, 0) for e in AFFINE_IN_PLACE], dtype=np.int64)
    facing = [toward(v, normals[some]) for v in viewing_directions(cameras.projection)]
    away = [cameras.image_derivatives(X, -n, i) for i, n in enumerate(facing)]
    added = [cameras.image_derivatives(X, n, i) - away[i] for i, n in enumerate(facing)]
    size = max(float(np.abs(one).max()) for one in (*away, *added)) or 1.0

    def fitted(basis: Float, values: Float) -> Float | None:
        """(2, B, p)"""
        right = values.reshape(len(X), -1)
        found = np.linalg.lstsq(basis, right, rcond=1e-10)[0]
        if np.abs(basis @ found - right).max() > MAX_MISFIT * size:
            return None
        return np.asarray(found.reshape(-1, *values.shape[1:]).transpose(1, 0, 2))

    affine = monomials(X, normals[some], of_place, center, radius)
    base = [fitted(affine, one) for one in away]
    for degree in (2, 4):
        of_normal = _of_normal(degree)
        more = [
            fitted(monomials(X, n, of_normal, center, radius), one)
            for one, n in zip(added, facing, strict=True)
        ]
        both = [
            np.concatenate([one, other], axis=1)
            for one, other in zip(base, more, strict=True)
            if one is not None and other is not None
        ]
        if len(both) == len(base):
            return np.concatenate([of_place, of_normal]), np.stack(both)
    return None, None


def viewing_directions(projection: Float) -> Float:
    """(M, 3) unit vectors from the viewer into the scene."""
    v = np.cross(projection[:, 0], projection[:, 1])
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def toward(viewing_direction: Float, normals: Float) -> Float:
    """Normals (K, 3), each turned to the viewer."""
    away = normals @ viewing_direction > 0.0
    return np.where(away[:, None], -normals, normals)


def _modes(
    cameras: ParameterCovariance, points: Float, normals: Float, weights: Float, neighbors: Int
) -> tuple[Float, float]:
    """Modes (n, r) of the parameters, and the largest share of a variance that they miss."""
    rng = np.random.default_rng(SEED)
    chosen = rng.permutation(len(points))[: min(NUM_PLACES, len(points))]
    far = rng.permutation(chosen)
    pairs = np.concatenate(
        [np.column_stack([chosen, neighbors[chosen]]), np.column_stack([chosen, far])]
    )
    pairs = pairs[np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) > 0.0]
    D = np.stack([_length(cameras, points, normals, weights, pair) for pair in pairs], axis=1)
    sigma = np.sqrt(np.einsum("np,np->p", D, cameras.times(D)))
    D = D[:, sigma > 0.0] / sigma[sigma > 0.0]
    fitted, tried = D[:, ::2], D[:, 1::2]
    along = cameras.times(fitted)
    value, vector = np.linalg.eigh(fitted.T @ along)
    kept = value > 1e-12 * value.max()
    modes = (along @ vector[:, kept] / np.sqrt(value[kept]))[:, ::-1]
    explained = np.cumsum((tried.T @ modes) ** 2, axis=1)
    loss = 1.0 - explained.min(axis=0)
    good = np.flatnonzero(loss <= MAX_LOSS)
    r = int(good[0]) + 1 if len(good) else modes.shape[1]
    return modes[:, :r], float(max(loss[r - 1], 0.0))


def _length(
    cameras: ParameterCovariance, points: Float, normals: Float, weights: Float, pair: Int
) -> Float:
    """Direction (n,) of the parameters for the distance of two places."""
    apart = points[pair[1]] - points[pair[0]]
    u = apart / np.linalg.norm(apart)
    return cameras.surface_direction(points[pair], normals[pair], weights[pair], np.stack([-u, u]))
