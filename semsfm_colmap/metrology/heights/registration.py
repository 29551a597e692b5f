"""Two surfaces of one specimen brought together, whatever has changed between them.

Iteratively closest points with point-to-plane distances [Chen, Medioni 1992]: for points p of one
surface and their nearest points q of the other with normals n there, the small motion (w, t, k),

    min sum_j weight_j ((p_j + w x p_j + t + k p_j - q_j) . n_j)^2,

k only where the scale is free. The weights are Tukey's of the distances, in units of their robust
scale among the nearest 60 % of the points: what was worn off or grown does not pull. The search
begins at several orientations, as each surface has a world of its own, and goes on from the best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.metrology.heights.coarse_registration import MIN_OVERLAP, starts
from semsfm_colmap.metrology.heights.height_map import seen_faces
from semsfm_colmap.types import Float, TriangleMesh

NUM_COARSE, NUM_FINE = 1500, 20_000
"""Points of a search from each start, and of the last one."""
COARSE_ROUNDS, FINE_ROUNDS = 40, 60
KEPT = 0.6
"""Share of the nearest points that tell the scale of the distances."""
TUKEY = 4.685
"""Rejection in robust standard deviations: 95 % efficiency on Gaussian errors."""
SETTLED = 1e-7
"""Motion of a round, relative to the size of the surface, that ends the search."""
MIN_UNCHANGED = 0.3
"""Least share of the points that must agree within their error bars."""
WITHIN = 3.0
"""Standard deviations within which they do."""
BESIDE = 3.0
"""Spacings of the vertices: points farther from them across the normal are beside the surface."""
MIN_ERROR_SCALE = 0.25
"""Least scale of distance / sigma: surfaces from disjoint halves of a series have 0.26 to 0.30."""
MIN_POINTS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """How one surface comes to lie on the other."""

    fixed_from_moving: Similarity
    scale_sigma: float
    """relative standard deviation of the scale; 0 where it was fixed"""
    unchanged_share: float
    """Share of the part that both have which agrees within the error bars"""
    error_scale: float
    """Robust scale of distance / sigma on that part, at least 0.25"""


def plane_jacobian(points: Float, normals: Float) -> Float:
    """(N, 7) derivatives of ``p . n`` with (w, t, k): ``(p x n, n, p . n)``."""
    along = np.sum(points * normals, axis=1)[:, None]
    return np.concatenate([np.cross(points, normals), normals, along], axis=1)


def register(
    fixed: TriangleMesh, moving: TriangleMesh, correlation_area: float, *, with_scale: bool = False
) -> Registration:
    """Bring `moving` onto `fixed`.

    Parameters
    ----------
    fixed, moving : with sigma at the vertices, in one unit
    correlation_area : within which errors are the same, unit squared: neighbours do not count twice
    with_scale : the scale is free, as where one of them has no pixel size

    Raises
    ------
    InputError
        No part of them agrees within the error bars.

    """
    if fixed.vertex_sigma is None or moving.vertex_sigma is None:
        raise InputError("A mesh has no error bars: make it anew with `semsfm mesh`.")
    base = Target(fixed)
    points, sigma = seen_vertices(moving)
    if min(len(points), len(base.points)) < MIN_POINTS:
        raise InputError("A surface has hardly any vertices: there is nothing to bring together.")
    coarse = points[np.linspace(0, len(points) - 1, min(len(points), NUM_COARSE)).astype(int)]
    tried = [
        search(base, coarse, start, with_scale, COARSE_ROUNDS) for start in starts(fixed, moving)
    ]
    best = min(tried, key=lambda found: base.misfit(found.apply(coarse)))
    pick = np.linspace(0, len(points) - 1, min(len(points), NUM_FINE)).astype(int)
    found = search(base, points[pick], best, with_scale, FINE_ROUNDS)
    return judged(base, found, points[pick], sigma[pick], correlation_area, with_scale)


class Target:
    """A surface that points are brought to: vertices, normals, error bars, nearest ones."""

    def __init__(self, mesh: TriangleMesh) -> None:
        used = np.unique(seen_faces(mesh))
        assert mesh.vertex_sigma is not None
        self.points = mesh.vertices[used]
        self.normals = vertex_normals(mesh.vertices, mesh.faces)[used]
        self.sigma = np.asarray(mesh.vertex_sigma, dtype=np.float64)[used]
        self.tree = cKDTree(self.points)
        self.centre = self.points.mean(axis=0)
        near = np.asarray(self.tree.query(self.points, k=2, workers=-1)[0])[:, 1]
        self.spacing = float(np.median(near))
        self.size = float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def nearest(self, points: Float) -> tuple[Float, Float, Float]:
        """Distances along the normals, normals and sigmas at the nearest vertices.

        The distance of a point beside the surface, beyond an end or over a hole, is nan.
        """
        idx = np.asarray(self.tree.query(points, workers=-1)[1])
        normals = self.normals[idx]
        gap = points - self.points[idx]
        along = np.sum(gap * normals, axis=1)
        across = np.linalg.norm(gap - along[:, None] * normals, axis=1)
        return np.where(across <= BESIDE * self.spacing, along, np.nan), normals, self.sigma[idx]

    def misfit(self, points: Float) -> float:
        """Mean distance of the nearest of the points over the surface; inf where few are."""
        along = self.nearest(points)[0]
        size = np.sort(np.abs(along[np.isfinite(along)]))
        if len(size) < MIN_OVERLAP * len(points):
            return float("inf")
        return float(size[: max(int(KEPT * len(size)), 1)].mean())


def seen_vertices(mesh: TriangleMesh) -> tuple[Float, Float]:
    """Vertices of faces that were seen, and their sigmas."""
    used = np.unique(seen_faces(mesh))
    assert mesh.vertex_sigma is not None
    return mesh.vertices[used], np.asarray(mesh.vertex_sigma, dtype=np.float64)[used]


def search(
    base: Target, points: Float, start: Similarity, with_scale: bool, rounds: int
) -> Similarity:
    """Rounds of nearest points and weighted least squares, until the motion has settled."""
    found = start
    for _ in range(rounds):
        placed = found.apply(points)
        along, normals, _ = base.nearest(placed)
        over = np.isfinite(along)
        if over.sum() < MIN_OVERLAP * len(points):
            break
        along, normals = along[over], normals[over]
        weight = tukey(along)
        J = plane_jacobian(placed[over] - base.centre, normals)
        if not with_scale:
            J = J[:, :6]
        root = np.sqrt(weight)[:, None]
        step = np.asarray(np.linalg.lstsq(root * J, -root[:, 0] * along, rcond=1e-9)[0])
        found = moved(found, step, base.centre)
        travel = np.linalg.norm(step[:3]) + np.linalg.norm(step[3:6]) / base.size
        if travel < SETTLED:
            break
    return found


def tukey(along: Float) -> Float:
    """Weights of distances: Tukey's biweight on the scale of the nearest ones."""
    size = np.abs(along)
    near = np.sort(size)[: max(int(KEPT * len(size)), 1)]
    # of a normal distribution 60 % lie within 0.842 sigma
    scale = max(float(near[-1]) / 0.842, 1e-12)
    share = np.minimum(size / (TUKEY * scale), 1.0)
    return np.asarray((1.0 - share**2) ** 2)


def moved(found: Similarity, step: Float, centre: Float) -> Similarity:
    """A similarity followed by a small motion about a centre."""
    R = rotation_from_vector(step[None, :3])[0]
    k = 1.0 + (float(step[6]) if len(step) > 6 else 0.0)
    return Similarity(
        rotation=R @ found.rotation,
        scale=k * found.scale,
        shift=k * (R @ (found.shift - centre)) + centre + step[3:6],
    )


def judged(
    base: Target,
    found: Similarity,
    points: Float,
    sigma: Float,
    correlation_area: float,
    with_scale: bool,
) -> Registration:
    """The registration with what the unchanged part says of it, or the reason for none."""
    placed = found.apply(points)
    along, normals, other = base.nearest(placed)
    spread = np.hypot(found.scale * sigma, other)
    over = np.isfinite(along)
    inside = over & (np.abs(along) <= WITHIN * spread)
    share = float(inside.sum() / max(int(over.sum()), int(MIN_OVERLAP * len(points)), 1))
    if share < MIN_UNCHANGED:
        raise InputError(
            f"Only {100 * share:.0f} % of the surfaces agree within their error bars, "
            f"{100 * MIN_UNCHANGED:.0f} % are needed: nothing tells how they lie to one another; "
            "compare surfaces that have an unchanged part in common."
        )
    robust = MAD_TO_SIGMA * float(np.median(np.abs(along[inside] / spread[inside])))
    scale = max(robust, MIN_ERROR_SCALE)
    J = plane_jacobian(placed - base.centre, normals)[inside]
    J = J if with_scale else J[:, :6]
    # each error is shared by all points within the correlation area
    spacing_area = np.prod(np.sort(np.ptp(base.points, axis=0))[1:]) / len(points)
    repeated = max(correlation_area / float(spacing_area), 1.0)
    information = (J / (scale * spread[inside, None]) ** 2).T @ J / repeated
    variance = np.linalg.pinv(information, hermitian=True)[-1, -1] if with_scale else 0.0
    return Registration(
        fixed_from_moving=found,
        scale_sigma=float(np.sqrt(variance)),
        unchanged_share=share,
        error_scale=scale,
    )
