"""Places and regions of a surface: pixels of an image, vertices, tracks, discs, polygons, labels.

A picked place is the meeting of a ray and the surface. With n the normal and v the ray, a surface
that moves by dS and a ray that moves by dR (across itself) carry it by

    dX = v (n . dS) / (n . v) + (I - v n^T / (n . v)) dR,

so that a value with gradient g by the place has the gradient ``n (g . v) / (n . v)`` by the surface
and the rest of g by the ray. At grazing incidence the first is large, and rightly so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import estimate_normals, mean_viewing_direction
from semsfm_colmap.metrology.sizes.specimen import NEAREST_TRACK_PX, Specimen, visible_vertices
from semsfm_colmap.types import Bool, Float, Int

MIN_INCIDENCE = 0.1
"""Least cosine between ray and normal that is divided by: 84 degrees."""
MIN_TANGENT = 0.3
"""The same for a tangent plane, which points around tell roughly: 73 degrees."""
MIN_COVERAGE = 0.98
"""Share of a region's pixels that must show surface where its area or volume is asked for."""
NUM_TRACK_NEIGHBORS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """K places, and what their errors come from."""

    points: Float
    """(K, 3)"""
    normals: Float
    """(K, 3) outward"""
    weights: Float
    """(K, M) of the images that see each"""
    sigma: Float
    """(K,) of the surface along the normal; nan for tracks, and where it is not known"""
    image: Int
    """(K,) in which it was picked, -1 for a vertex or a track"""
    track: Bool
    """(K,) it is a reconstructed point, not one of the surface"""
    scatter: Float
    """(K,) of the surface about the feature that was fitted to it, which tells its relief and noise
    better than `sigma`; nan where there is no fit"""

    def __len__(self) -> int:
        return len(self.points)

    def select(self, some: Int) -> Places:
        """Some of them, by their numbers."""
        return Places(**{f.name: getattr(self, f.name)[some] for f in fields(Places)})

    def about_a_fit(self, scatter: float) -> Places:
        """The same places, their relief and noise known from a fit's distances."""
        return replace(self, scatter=np.full(len(self), scatter))

    @staticmethod
    def joined(*parts: Places) -> Places:
        """All places of several sets, in their order."""
        names = [f.name for f in fields(Places)]
        return Places(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})


def at_pixel(specimen: Specimen, image_name: str, xy: tuple[float, float], what: str) -> Places:
    """The place that a pixel of an original image shows.

    Raises
    ------
    InputError
        It lies outside of the image or its mask, or no surface is there.

    """
    image = specimen.image_named(image_name)
    pixel = specimen.prepared_pixel(image, np.array([xy]), what)
    if specimen.mesh is None:
        return by_track(specimen, image, specimen.undrifted(image, pixel)[0], image_name, what)
    hits = specimen.hits(image, pixel)
    if not hits.found[0] or hits.filled[0]:
        why = "closes a hole that no image shows" if hits.found[0] else "is not there"
        raise InputError(
            f"{what}: the surface at {image_name}:{xy[0]:g},{xy[1]:g} {why}: pick a place where "
            "the mesh has been seen (report.html shows it)"
        )
    return on_surface(specimen, hits.points, hits.normals, hits.vertices, np.array([image]))


def by_track(specimen: Specimen, image: int, pixel: Float, image_name: str, what: str) -> Places:
    """Where the ray of a pixel meets the tangent plane of the reconstructed point next to it.

    It errs as that point does along its normal, and as any picked place across its ray.
    """
    track, there = specimen.nearest_track(image, pixel)
    if np.linalg.norm(there - pixel) > NEAREST_TRACK_PX:
        x, y = there + specimen.crop_origin(specimen.model.image_names[image])
        raise InputError(
            f"{what}: no reconstructed point lies within {NEAREST_TRACK_PX:g} px of the place in "
            f"{image_name}, and there is no mesh: run `semsfm densify` and `semsfm mesh`, or "
            f"pick a point, the nearest being at {image_name}:{x:.0f},{y:.0f}"
        )
    found = at_tracks(specimen, np.array([track]))
    n, v = found.normals[0], specimen.model.cameras.viewing_direction[image]
    ray = specimen.on_rays(image, pixel[None])[0]
    depth = (found.points[0] - ray) @ n / min(float(n @ v), -MIN_TANGENT)
    return replace(found, points=(ray + depth * v)[None], image=np.array([image]))


def on_surface(
    specimen: Specimen, points: Float, normals: Float, vertices: Int, image: Int
) -> Places:
    """Places on the mesh, each as uncertain as the vertex nearest to it."""
    assert specimen.mesh is not None
    sigma = specimen.mesh.vertex_sigma
    return Places(
        points=points,
        normals=normals,
        weights=specimen.seen_by(points, normals),
        sigma=np.full(len(points), np.nan) if sigma is None else np.asarray(sigma)[vertices],
        image=image,
        track=np.zeros(len(points), dtype=bool),
        scatter=np.full(len(points), np.nan),
    )


def at_vertices(specimen: Specimen, vertices: Int) -> Places:
    """Vertices of the mesh."""
    assert specimen.mesh is not None
    nowhere = np.full(len(vertices), -1, dtype=np.int64)
    points, normals = specimen.mesh.vertices[vertices], specimen.normals[vertices]
    return on_surface(specimen, points, normals, vertices, nowhere)


def at_vertex(specimen: Specimen, number: int, what: str) -> Places:
    """One vertex by its number in mesh.ply.

    Raises
    ------
    InputError
        There is no mesh, or no such vertex.

    """
    if specimen.mesh is None:
        raise InputError(f"{what}: there is no mesh: run `semsfm densify` and `semsfm mesh`")
    if not 0 <= number < len(specimen.mesh.vertices):
        raise InputError(
            f"{what}: vertex {number} does not exist: the mesh has vertices 0 to "
            f"{len(specimen.mesh.vertices) - 1}"
        )
    return at_vertices(specimen, np.array([number]))


def at_tracks(specimen: Specimen, tracks: Int) -> Places:
    """Reconstructed points, with the images that they were triangulated from."""
    model = specimen.model
    obs = model.observations
    rows = np.flatnonzero(model.inlier & np.isin(obs.track_idx, tracks))
    place = {int(track): k for k, track in enumerate(tracks)}
    weights = np.zeros((len(tracks), model.num_images))
    number = np.array([place[int(t)] for t in obs.track_idx[rows]], dtype=np.int64)
    weights[number, obs.image_idx[rows]] = obs.precision[rows]
    toward = mean_viewing_direction(model)
    near = min(NUM_TRACK_NEIGHBORS, len(model.points) - 1)
    return Places(
        points=model.points[tracks],
        normals=estimate_normals(model.points, toward, near)[tracks],
        weights=weights,
        sigma=np.full(len(tracks), np.nan),
        image=np.full(len(tracks), -1, dtype=np.int64),
        track=np.ones(len(tracks), dtype=bool),
        scatter=np.full(len(tracks), np.nan),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """A part of the mesh."""

    vertices: Int
    missing: float = 0.0
    """share of its pixels that show no surface, where it was drawn in an image"""

    @staticmethod
    def union(parts: Sequence[Region]) -> Region:
        """What lies in any of several."""
        return Region(
            vertices=np.unique(np.concatenate([part.vertices for part in parts])),
            missing=max(part.missing for part in parts),
        )


def in_polygon(
    specimen: Specimen, image_name: str, corners: Float, what: str, *, whole: bool = False
) -> Region:
    """Vertices that an image shows within a polygon of original pixels (C, 2).

    Parameters
    ----------
    whole : the region must be without holes

    Raises
    ------
    InputError
        A corner lies outside of the image; no surface; a hole where there must be none.

    """
    if specimen.mesh is None:
        raise InputError(f"{what}: there is no mesh: run `semsfm densify` and `semsfm mesh`")
    if len(corners) < 3:
        raise InputError(f"{what}: a polygon has 3 corners or more, not {len(corners)}")
    image = specimen.image_named(image_name)
    prepared = specimen.prepared_pixel(image, corners, what)
    low, high = np.floor(prepared.min(axis=0)), np.ceil(prepared.max(axis=0))
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]] + 0.5
    pixels = np.column_stack([u.ravel(), v.ravel()])
    pixels = pixels[inside(pixels, prepared)]
    if len(pixels) == 0:
        raise InputError(f"{what}: the polygon holds no pixel: make it larger")
    hits = specimen.hits(image, pixels)
    seen = hits.found & ~hits.filled
    if not seen.any():
        raise InputError(f"{what}: no surface is there: choose a region where the mesh is")
    if whole and hits.found.mean() < MIN_COVERAGE:
        raise InputError(
            f"{what}: {1.0 - hits.found.mean():.0%} of the region has no surface, so that its area "
            "or volume is not known: choose a region without holes, or close them with "
            "`semsfm mesh --surface.fill_holes all`"
        )
    chosen, where = visible_vertices(specimen, image)
    return Region(vertices=chosen[inside(where, prepared)], missing=1.0 - float(hits.found.mean()))


def inside(points: Float, corners: Float) -> Bool:
    """Which points (K, 2) lie in a polygon (C, 2), by the even-odd rule."""
    x, y = points[:, :1], points[:, 1:]
    a, b = corners, np.roll(corners, -1, axis=0)
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    slope = (b[:, 0] - a[:, 0]) / np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossed = spans & (x < a[:, 0] + (y - a[:, 1]) * slope)
    return np.asarray(crossed.sum(axis=1) % 2 == 1)


def with_label(specimen: Specimen, name: str, what: str) -> Region:
    """Vertices of a part that `semsfm segment` has named.

    Raises
    ------
    InputError
        There is no segmentation of this mesh, or no such part.

    """
    if specimen.labels is None:
        raise InputError(f"{what}: the mesh has no labels: run `semsfm segment` first")
    if name not in specimen.label_names:
        raise InputError(
            f"{what}: no part is named {name}: the parts are {', '.join(specimen.label_names)}"
        )
    return Region(vertices=np.flatnonzero(specimen.labels == specimen.label_names[name]))


def gradients(places: Places, gradient: Float, viewing_direction: Float) -> tuple[Float, Float]:
    """The module's gradient by the surface and by the rays, (K, 3) each."""
    picked = places.image >= 0
    by_surface, by_ray = np.array(gradient, dtype=np.float64), np.zeros_like(gradient)
    v, n = viewing_direction[places.image[picked]], places.normals[picked]
    incidence = np.minimum(np.einsum("ki,ki->k", n, v), -MIN_INCIDENCE)
    along = np.einsum("ki,ki->k", gradient[picked], v) / incidence
    by_surface[picked] = along[:, None] * n
    rest = gradient[picked] - by_surface[picked]
    by_ray[picked] = rest - np.einsum("ki,ki->k", rest, v)[:, None] * v
    return by_surface, by_ray
