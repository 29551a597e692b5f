"""Ideal features fitted to surface points by orthogonal distance, and how they follow the points.

A feature of parameters theta has for each point x_k one or two signed distances r_kc, with
``dr_kc / dx_k = D_kc`` a unit vector. The fit minimises ``sum_k w_k sum_c r_kc^2`` (Gauss-Newton),
w_k the weights of Cauchy's loss at the residuals' own scale where that is asked for. At its minimum
it follows the points by

    dtheta = -(J^T W J)^-1 J^T W D dx,

J the derivative of the distances by theta (terms with residuals times curvature are left out). What
is measured is a function of theta, such as the radius, and so has a gradient by every point,
through which all covariances go (`metrology.covariance`).

Parametrisations are local: a direction n moves by two components across itself, so that none is
singular anywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Generic, Self, TypeVar

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA, weight
from semsfm_colmap.types import Float

MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-10
"""Relative to the extent of the points."""
CAUCHY_TUNING = 2.385
"""Width of Cauchy's loss in one coordinate: 95 % efficiency on Gaussian errors [Holland 1977]."""
MIN_SCATTER_POINTS = 50
"""Fewer distances do not tell their scatter."""
DETERMINED = 1e-10
"""Smallest eigenvalue of the normal matrix, relative to the largest, both in units of the
extent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Feature(ABC):
    """An ideal shape in space."""

    name = "feature"
    min_points = 3

    @classmethod
    @abstractmethod
    def start(cls, points: Float, normals: Float) -> Self:
        """A first guess by linear means."""

    @abstractmethod
    def distances(self, points: Float) -> tuple[Float, Float]:
        """R (K, C) and D (K, C, 3)."""

    @abstractmethod
    def jacobian(self, points: Float) -> Float:
        """Derivative of r by the local parameters: (K, C, P)."""

    @abstractmethod
    def moved(self, step: Float) -> Self:
        """The feature after a step (P,) of the local parameters."""


F = TypeVar("F", bound=Feature)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Generic[F]):
    """A feature and how its local parameters follow the points."""

    feature: F
    response: Float
    """(P, K, 3): d theta / d x"""
    rms: float
    """Of the distances, with their weights: the form deviation in the least squares sense"""
    scatter: float
    """Robust standard deviation of the distances; nan for too few to tell"""
    peak_to_valley: float
    """Largest minus smallest distance"""


def across(direction: Float) -> Float:
    """Two unit vectors (2, 3) at right angles to a direction and to one another."""
    side = np.eye(3)[int(np.argmin(np.abs(direction)))]
    u = np.cross(direction, side)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(direction, u)])


def algebraic_sphere(x: Float) -> tuple[Float, float]:
    """Centre and radius of a circle or sphere by the linear ``2 c . x + (R^2 - c^2) = x^2``."""
    A = np.column_stack([2.0 * x, np.ones(len(x))])
    solved = np.linalg.lstsq(A, np.sum(x * x, axis=1), rcond=None)[0]
    middle = solved[:-1]
    return middle, float(np.sqrt(max(float(solved[-1] + middle @ middle), 1e-300)))


def turned(direction: Float, step: Float) -> Float:
    """A direction moved by two components across itself."""
    moved = direction + step @ across(direction)
    return np.asarray(moved / np.linalg.norm(moved))


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane(Feature):
    """``n . (x - c) = 0``, with c the mean of the points; parameters: n across itself, offset."""

    normal: Float
    centre: Float
    name = "plane"
    min_points = 3

    @classmethod
    def start(cls, points: Float, normals: Float) -> Plane:
        """The best plane by the smallest principal component, on the side of the normals."""
        centre = points.mean(axis=0)
        _, _, Vt = np.linalg.svd(points - centre, full_matrices=False)
        n = Vt[2] if normals.sum(axis=0) @ Vt[2] >= 0.0 else -Vt[2]
        return cls(normal=np.asarray(n), centre=np.asarray(centre))

    def distances(self, points: Float) -> tuple[Float, Float]:
        """Positive on the side of the normal."""
        r = (points - self.centre) @ self.normal
        return r[:, None], np.broadcast_to(self.normal, (len(points), 1, 3))

    def jacobian(self, points: Float) -> Float:
        """By the two turns of the normal and the offset along it."""
        turn = (points - self.centre) @ across(self.normal).T
        return np.concatenate([turn, -np.ones((len(points), 1))], axis=1)[:, None, :]

    def moved(self, step: Float) -> Plane:
        """Turned about its centre, then shifted."""
        n = turned(self.normal, step[:2])
        return replace(self, normal=n, centre=self.centre + step[2] * self.normal)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sphere(Feature):
    """``|x - c| = R``; parameters: c, R."""

    centre: Float
    radius: float
    name = "sphere"
    min_points = 4

    @classmethod
    def start(cls, points: Float, normals: Float) -> Sphere:
        """The algebraic one."""
        mean = points.mean(axis=0)
        middle, radius = algebraic_sphere(points - mean)
        return cls(centre=np.asarray(mean + middle), radius=radius)

    def distances(self, points: Float) -> tuple[Float, Float]:
        """Positive outside."""
        away = points - self.centre
        length = np.linalg.norm(away, axis=1)
        return (length - self.radius)[:, None], (away / length[:, None])[:, None, :]

    def jacobian(self, points: Float) -> Float:
        """By centre and radius."""
        _, D = self.distances(points)
        return np.concatenate([-D, -np.ones((len(points), 1, 1))], axis=2)

    def moved(self, step: Float) -> Sphere:
        """Shifted and grown."""
        return replace(self, centre=self.centre + step[:3], radius=self.radius + float(step[3]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Cylinder(Feature):
    """Distance R from the axis c + t a; parameters: a across itself, c across a, R."""

    axis: Float
    centre: Float
    radius: float
    name = "cylinder"
    min_points = 5

    @classmethod
    def start(cls, points: Float, normals: Float) -> Cylinder:
        """The axis at right angles to the normals, then a circle across it."""
        _, _, Vt = np.linalg.svd(normals, full_matrices=False)
        axis = np.asarray(Vt[2])
        e = across(axis)
        mean = points.mean(axis=0)
        middle, radius = algebraic_sphere((points - mean) @ e.T)
        return cls(axis=axis, centre=np.asarray(mean + middle @ e), radius=radius)

    def distances(self, points: Float) -> tuple[Float, Float]:
        """Positive outside."""
        away = points - self.centre
        away = away - (away @ self.axis)[:, None] * self.axis
        length = np.linalg.norm(away, axis=1)
        return (length - self.radius)[:, None], (away / length[:, None])[:, None, :]

    def jacobian(self, points: Float) -> Float:
        """By the turns of the axis about its centre, the shifts across it and the radius."""
        _, D = self.distances(points)
        e = across(self.axis)
        toward = np.einsum("kci,ai->kca", D, e)
        along = ((points - self.centre) @ self.axis)[:, None, None]
        return np.concatenate([-along * toward, -toward, -np.ones((len(points), 1, 1))], axis=2)

    def moved(self, step: Float) -> Cylinder:
        """Turned, shifted across its axis, grown."""
        centre = self.centre + step[2:4] @ across(self.axis)
        axis = turned(self.axis, step[:2])
        return replace(self, axis=axis, centre=centre, radius=self.radius + float(step[4]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Circle(Feature):
    """A circle in space: distances within its plane and out of it; parameters: n, c, R."""

    normal: Float
    centre: Float
    radius: float
    name = "circle"
    min_points = 3

    @classmethod
    def start(cls, points: Float, normals: Float) -> Circle:
        """The plane of the points, then a circle within it."""
        plane = Plane.start(points, normals)
        e = across(plane.normal)
        middle, radius = algebraic_sphere((points - plane.centre) @ e.T)
        centre = np.asarray(plane.centre + middle @ e)
        return cls(normal=plane.normal, centre=centre, radius=radius)

    def distances(self, points: Float) -> tuple[Float, Float]:
        """From the circle within its plane, positive outside, and from the plane."""
        away = points - self.centre
        out = away @ self.normal
        within = away - out[:, None] * self.normal
        length = np.linalg.norm(within, axis=1)
        D = np.stack([within / length[:, None], np.broadcast_to(self.normal, within.shape)], axis=1)
        return np.column_stack([length - self.radius, out]), D

    def jacobian(self, points: Float) -> Float:
        """By the turns of the normal, the centre and the radius."""
        r, D = self.distances(points)
        e = across(self.normal)
        turn = np.zeros((len(points), 2, 2))
        turn[:, 1] = (points - self.centre) @ e.T
        turn[:, 0] = -r[:, 1, None] * (D[:, 0] @ e.T)
        grow = np.zeros((len(points), 2, 1))
        grow[:, 0] = -1.0
        return np.concatenate([turn, -D, grow], axis=2)

    def moved(self, step: Float) -> Circle:
        """Turned, shifted, grown."""
        return replace(
            self,
            normal=turned(self.normal, step[:2]),
            centre=self.centre + step[2:5],
            radius=self.radius + float(step[5]),
        )


def fit(
    kind: type[F], points: Float, normals: Float, *, robust: bool = True, what: str = "the region"
) -> Fit[F]:
    """The feature nearest to points.

    Parameters
    ----------
    points, normals : (K, 3); the normals only choose a side and a first axis
    robust : weigh points that lie far off by Cauchy's loss
    what : name of the points in a message

    Raises
    ------
    InputError
        Too few points, or points that leave the feature undetermined.

    """
    if len(points) < kind.min_points:
        raise InputError(
            f"{what} holds {len(points)} points of the surface, but a {kind.name} needs "
            f"{kind.min_points}: make the region larger"
        )
    extent = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    feature = kind.start(points, normals)
    w = np.ones(len(points))
    for _ in range(MAX_ITERATIONS):
        w = robust_weights(feature.distances(points)[0]) if robust else w
        step = -_solve(feature, points, w, extent, what) @ _pull(feature, points, w)
        feature = feature.moved(step)
        if np.linalg.norm(step) <= STEP_TOLERANCE * max(extent, 1.0):
            break
    r, D = feature.distances(points)
    J = feature.jacobian(points)
    inverse = _solve(feature, points, w, extent, what)
    response = -np.einsum("pq,kcq,k,kci->pki", inverse, J, w, D)
    return Fit(
        feature=feature,
        response=response,
        rms=float(np.sqrt(np.sum(w[:, None] * r**2) / w.sum())),
        scatter=robust_scatter(r),
        peak_to_valley=float(np.ptp(r[:, 0])),
    )


def robust_scatter(r: Float) -> float:
    """Standard deviation that counts for a fit to distances (K, C); nan for too few to tell.

    An estimate with the influence psi = w r has the variance ``E[psi^2] / E[psi']^2`` over the
    number [Huber and Ronchetti 2009, section 3.2]; one whose weights are held has
    ``s^2 E[w^2] / E[w]^2``. They agree, however long the tails, at

        s = sqrt(E[psi^2] / E[w^2]) E[w] / E[psi'],    psi' = w^2 (1 - r^2 / c^2).
    """
    if len(r) < MIN_SCATTER_POINTS:
        return float("nan")
    s = np.sum(r**2, axis=1) / r.shape[1]
    scale = MAD_TO_SIGMA**2 * float(np.median(s))
    if scale <= 0.0:
        return 0.0
    w = weight("cauchy", s / scale, CAUCHY_TUNING)
    slope = float(np.mean(w**2 * (1.0 - s / (scale * CAUCHY_TUNING**2))))
    return float(np.sqrt(np.mean(w**2 * s) / np.mean(w**2)) * np.mean(w) / slope)


def robust_weights(r: Float) -> Float:
    """Weights (K,) of Cauchy's loss for distances (K, C), at their own scale."""
    s = np.sum(r**2, axis=1)
    scale = MAD_TO_SIGMA**2 * float(np.median(s)) / r.shape[1]
    if scale <= 0.0:
        return np.ones(len(r))
    return weight("cauchy", s / scale, CAUCHY_TUNING)


def _pull(feature: Feature, points: Float, w: Float) -> Float:
    r, _ = feature.distances(points)
    return np.asarray(np.einsum("kcp,k,kc->p", feature.jacobian(points), w, r))


def _solve(feature: Feature, points: Float, w: Float, extent: float, what: str) -> Float:
    """``(J^T W J)^-1``, if it is one."""
    J = feature.jacobian(points)
    N = np.einsum("kcp,k,kcq->pq", J, w, J)
    size = np.sqrt(np.maximum(np.diag(N), 1e-300))
    scaled = N / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] <= DETERMINED:
        raise InputError(
            f"{what} does not determine a {feature.name}: its points are too much alike; make the "
            "region larger, or fit another feature"
        )
    return np.asarray(np.linalg.inv(scaled) / np.outer(size, size))
