"""What is measured of places and regions: a value, and its gradient by every place.

Through the gradient g_k = df / dx_k go all covariances (`metrology.covariance`), so that what
places share drops out of their differences. Values are in world units to the power of their
dimension, angles in rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.metrology.sizes.fits import (
    Circle,
    Cylinder,
    Feature,
    Fit,
    Plane,
    Sphere,
    across,
    fit,
    robust_scatter,
    robust_weights,
)
from semsfm_colmap.metrology.sizes.places import Places
from semsfm_colmap.types import Float, Int

NUM_REWEIGHTINGS = 20
"""Enough for the weights of a step's planes to settle to a part in 10^6 of the height."""
PARALLEL = 1e-9
"""Sine of the angle below which two directions are parallel to the last digits."""
MISFIT = 2.5
"""Scatter about a fit, in sigmas of the surface, from which it is the form of the surface."""
FINE_AREA = "area of relief finer than the windows, which is lost, and of the mesh's own noise"
FITS: dict[str, type[Feature]] = {
    "sphere": Sphere,
    "cylinder": Cylinder,
    "circle": Circle,
    "plane": Plane,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """A value f of K places."""

    value: float
    gradient: Float
    """(K, 3) df / dx"""
    places: Places
    dimension: int
    """power of the unit of length: 0 for an angle"""
    facts: Mapping[str, float] = field(default_factory=dict)
    """what else is known of it, such as the form deviation of a fit, in world units"""
    missing: float = 0.0
    """share of an area or volume that has no surface and counts as nothing"""
    remarks: tuple[str, ...] = ()
    """sentences that must be read with the value"""
    not_assessed: tuple[str, ...] = ()
    """what moves this kind of value and is in no line of its budget"""

    def scaled(self, factor: float) -> Quantity:
        """The value times a number."""
        return replace(self, value=factor * self.value, gradient=factor * self.gradient)


def times(a: Quantity, b: Quantity, power: float) -> Quantity:
    """``a b^power``, with all that the two share."""
    factor = b.value**power
    by_b = power * a.value * factor / b.value * b.gradient
    return replace(
        a,
        value=a.value * factor,
        gradient=np.concatenate([factor * a.gradient, by_b]),
        places=Places.joined(a.places, b.places),
    )


def distance(a: Places, b: Places, what: str) -> Quantity:
    """``|x_b - x_a|``."""
    apart = b.points[0] - a.points[0]
    length = float(np.linalg.norm(apart))
    if length == 0.0:
        raise InputError(f"{what}: both places are one: pick two")
    u = apart / length
    return Quantity(
        value=length, gradient=np.stack([-u, u]), places=Places.joined(a, b), dimension=1
    )


def angle(a: Places, corner: Places, b: Places, what: str) -> Quantity:
    """Angle at a corner between the directions to two places."""
    p, q = a.points[0] - corner.points[0], b.points[0] - corner.points[0]
    size = float(np.linalg.norm(p)), float(np.linalg.norm(q))
    if min(size) == 0.0:
        raise InputError(f"{what}: the corner is one of the ends: pick three places")
    p, q = p / size[0], q / size[1]
    by_p, by_q = _angle_gradient(p, q)
    by_a, by_b = by_p / size[0], by_q / size[1]
    return Quantity(
        value=float(np.arctan2(np.linalg.norm(np.cross(p, q)), p @ q)),
        gradient=np.stack([by_a, -by_a - by_b, by_b]),
        places=Places.joined(a, corner, b),
        dimension=0,
    )


def _angle_gradient(p: Float, q: Float) -> tuple[Float, Float]:
    """Gradients of the angle between unit vectors, across each; any such for parallel ones."""
    cosine = float(p @ q)
    sine = float(np.linalg.norm(np.cross(p, q)))
    if sine < PARALLEL:
        e = across(p)[0]
        return -e, np.copysign(1.0, cosine) * e
    return -(q - cosine * p) / sine, -(p - cosine * q) / sine


def fitted(kind: str, places: Places, what: str) -> tuple[Fit[Feature], dict[str, float]]:
    """A feature fitted to places, and its form deviation."""
    found = fit(FITS[kind], places.points, places.normals, what=what)
    return found, {"rms_deviation": found.rms, "peak_to_valley": found.peak_to_valley}


def misfit(kind: str, found: Fit[Feature], places: Places) -> tuple[str, ...]:
    """A remark where the surface departs from a feature by more than it is uncertain by."""
    sigma = float(np.median(places.sigma))
    if not found.scatter > MISFIT * sigma:
        return ()
    return (
        f"the surface departs from the best {kind} by {found.scatter / sigma:.0f} times its sigma "
        f"(rms_deviation): the value is that of the best {kind}, and depends on the region",
    )


def radius(kind: str, places: Places, what: str) -> Quantity:
    """Radius of a sphere, cylinder or circle; the last local parameter of each."""
    found, facts = fitted(kind, places, what)
    feature = found.feature
    assert isinstance(feature, (Sphere, Cylinder, Circle))
    return Quantity(
        value=feature.radius,
        gradient=found.response[-1],
        places=places.about_a_fit(found.scatter),
        dimension=1,
        facts=facts,
        remarks=misfit(kind, found, places),
    )


def plane_angle(a: Places, b: Places, what: str) -> Quantity:
    """Angle between the outward normals of two planes."""
    (p, facts), (q, _) = fitted("plane", a, what), fitted("plane", b, what)
    assert isinstance(p.feature, Plane)
    assert isinstance(q.feature, Plane)
    n, m = p.feature.normal, q.feature.normal
    by_n, by_m = _angle_gradient(n, m)
    gradient = [_by_normal(p, by_n), _by_normal(q, by_m)]
    return Quantity(
        value=float(np.arctan2(np.linalg.norm(np.cross(n, m)), n @ m)),
        gradient=np.concatenate(gradient),
        places=Places.joined(a.about_a_fit(p.scatter), b.about_a_fit(q.scatter)),
        dimension=0,
        facts=facts,
        remarks=misfit("plane", p, a) + misfit("plane", q, b),
    )


def _by_normal(found: Fit[Feature], gradient: Float) -> Float:
    """Gradient (K, 3) by the points of what has this one by the plane's normal."""
    assert isinstance(found.feature, Plane)
    local = across(found.feature.normal) @ gradient
    return np.asarray(np.einsum("p,pki->ki", local, found.response[:2]))


def point_to_plane(place: Places, region: Places, what: str) -> Quantity:
    """Height of a place over a plane, positive on its outward side."""
    found, facts = fitted("plane", region, what)
    plane = found.feature
    assert isinstance(plane, Plane)
    away = place.points[0] - plane.centre
    by_region = _by_normal(found, away) - found.response[2]
    return Quantity(
        value=float(away @ plane.normal),
        gradient=np.concatenate([plane.normal[None], by_region]),
        places=Places.joined(place, region.about_a_fit(found.scatter)),
        dimension=1,
        facts=facts,
        remarks=misfit("plane", found, region),
    )


def step_height(low: Places, high: Places, what: str) -> Quantity:
    """Distance of two parallel planes fitted to two regions together, as ISO 5436-1 has it.

    With a common normal n, ``min sum_A w (n . x - d_A)^2 + sum_B w (n . x - d_B)^2``, w the weights
    of Cauchy's loss: n is the least principal component of the points about their weighted means,
    the height ``h = n . (m_B - m_A)``. A turn of n by e across it changes h by ``e . (m_B - m_A)``;
    the points turn it by ``-M^-1 sum_k w_k (e . y_k) (n . dx_k)``, y_k the points about their
    means, ``M = sum w y y^T`` across n.
    """
    for places in (low, high):
        if len(places) < Plane.min_points:
            raise InputError(
                f"{what}: a region holds {len(places)} points of the surface, but a plane needs "
                f"{Plane.min_points}: make it larger"
            )
    x = np.concatenate([low.points, high.points])
    of_high = np.arange(len(x)) >= len(low)
    w = np.ones(len(x))
    for _ in range(NUM_REWEIGHTINGS):
        means = np.stack([np.average(x[of], axis=0, weights=w[of]) for of in (~of_high, of_high)])
        y = x - means[of_high.astype(np.int64)]
        _, _, Vt = np.linalg.svd(np.sqrt(w)[:, None] * y, full_matrices=False)
        n = Vt[2]
        w = robust_weights((y @ n)[:, None])
    toward = low.normals.sum(axis=0) + high.normals.sum(axis=0)
    n = n if toward @ n >= 0.0 else -n
    apart, e = means[1] - means[0], across(n)
    within = y @ e.T
    turn = -np.linalg.solve((w[:, None] * within).T @ within, (w[:, None] * within).T)  # (2, K)
    share = w / np.where(of_high, w[of_high].sum(), -w[~of_high].sum())
    along = (e @ apart) @ turn + share
    r = y @ n
    scatter = [robust_scatter(r[of][:, None]) for of in (~of_high, of_high)]
    return Quantity(
        value=float(n @ apart),
        gradient=along[:, None] * n,
        places=Places.joined(low.about_a_fit(scatter[0]), high.about_a_fit(scatter[1])),
        dimension=1,
        facts={
            "rms_deviation": float(np.sqrt(np.average(r**2, weights=w))),
            "peak_to_valley": float(np.ptp(r)),
        },
    )


def area(places: Places, faces: Int, share: Float, what: str) -> Quantity:
    """Area of faces (F, 3) between the places, each counted by its share (F,) in the region."""
    if len(faces) == 0:
        raise InputError(f"{what} holds no face of the mesh: make the region larger")
    doubled = face_normals(places.points, faces)
    size = np.linalg.norm(doubled, axis=1)
    n = share[:, None] * doubled / np.maximum(size, 1e-300)[:, None]
    gradient = np.zeros_like(places.points)
    for k in range(3):
        b, c = (places.points[faces[:, (k + j) % 3]] for j in (1, 2))
        np.add.at(gradient, faces[:, k], 0.5 * np.cross(n, c - b))
    return Quantity(
        value=float(0.5 * share @ size),
        gradient=gradient,
        places=places,
        dimension=2,
        not_assessed=(FINE_AREA,),
    )


def closed_volume(places: Places, faces: Int, what: str) -> Quantity:
    """Volume ``sum a . (b x c) / 6`` of a closed mesh that faces outside.

    Raises
    ------
    InputError
        It has open edges: it encloses nothing.

    """
    edge = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(edge, axis=0, return_counts=True)
    num_open = int(np.sum(count != 2))
    if num_open or len(faces) == 0:
        raise InputError(
            f"{what} is open ({num_open} open edges) and encloses no volume: mesh it with "
            "`semsfm mesh --surface.fill_holes all`, or ask for the volume above a plane"
        )
    x = places.points - places.points.mean(axis=0)
    a, b, c = (x[faces[:, k]] for k in range(3))
    gradient = np.zeros_like(x)
    for k, (p, q) in enumerate(((b, c), (c, a), (a, b))):
        np.add.at(gradient, faces[:, k], np.cross(p, q) / 6.0)
    return Quantity(
        value=float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0),
        gradient=gradient,
        places=places,
        dimension=3,
    )


def volume_above(region: Places, faces: Int, share: Float, base: Places, what: str) -> Quantity:
    """Volume between faces and the plane of a base region, ``sum (a_f . n) h_f``.

    a_f is the vector area of a face times its share (F,) in the region, h_f the height of its
    middle above the plane; what lies below the plane counts negative.
    """
    if len(faces) == 0:
        raise InputError(f"{what} holds no face of the mesh: make the region larger")
    found, facts = fitted("plane", base, what)
    plane = found.feature
    assert isinstance(plane, Plane)
    n = plane.normal
    x = region.points - plane.centre
    vector = 0.5 * share[:, None] * face_normals(x, faces)
    middle = x[faces].mean(axis=1)
    projected, height = vector @ n, middle @ n
    gradient = np.zeros_like(x)
    for k in range(3):
        b, c = (x[faces[:, (k + j) % 3]] for j in (1, 2))
        turned_edge = 0.5 * (share * height)[:, None] * np.cross(n, c - b)
        np.add.at(gradient, faces[:, k], turned_edge)
        np.add.at(gradient, faces[:, k], projected[:, None] / 3.0 * n)
    by_normal = height @ vector + projected @ middle
    by_base = _by_normal(found, by_normal) - projected.sum() * found.response[2]
    return Quantity(
        value=float(projected @ height),
        gradient=np.concatenate([gradient, by_base]),
        places=Places.joined(region, base.about_a_fit(found.scatter)),
        dimension=3,
        facts={**facts, "projected_area": float(projected.sum())},
        remarks=misfit("plane", found, base),
    )


def profile(
    ends: tuple[Places, Places], samples: Places, viewing_direction: Float
) -> list[Quantity]:
    """Heights of samples over the straight line between two ends, toward the viewer.

    In the plane of the line and the viewing direction v, with t the line's direction and
    ``e = -(v - (v . t) t)`` normalised: ``h = e . (x - x_a)``.
    """
    a, b = ends
    apart = b.points[0] - a.points[0]
    length = float(np.linalg.norm(apart))
    t = apart / length
    e = -(viewing_direction - (viewing_direction @ t) * t)
    e = e / np.linalg.norm(e)
    found = []
    for k in range(len(samples)):
        one = samples.select(np.array([k]))
        away = one.points[0] - a.points[0]
        along = float(away @ t)
        # the line turns with its ends: at this place by (1 - s) of a's error and s of b's
        s = along / length
        found.append(
            Quantity(
                value=float(away @ e),
                gradient=np.stack([-(1.0 - s) * e, -s * e, e]),
                places=Places.joined(a, b, one),
                dimension=1,
                facts={"along": along},
            )
        )
    return found
