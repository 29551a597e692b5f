"""Requests answered: places found, values measured, budgets drawn up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.sizes.budget import Measurement, measurement, standard_uncertainty
from semsfm_colmap.metrology.sizes.covariance import Errors, ScaleError
from semsfm_colmap.metrology.sizes.places import (
    Places,
    Region,
    at_pixel,
    at_vertex,
    at_vertices,
    in_polygon,
    on_surface,
    with_label,
)
from semsfm_colmap.metrology.sizes.quantities import (
    Quantity,
    angle,
    area,
    closed_volume,
    distance,
    plane_angle,
    point_to_plane,
    profile,
    radius,
    step_height,
    times,
    volume_above,
)
from semsfm_colmap.metrology.sizes.requests import (
    ROUND,
    MeasurementRequest,
    PlaceRequest,
    RegionRequest,
    Requests,
)
from semsfm_colmap.metrology.sizes.specimen import Specimen

WITHOUT_HOLES = ("area", "volume_above")
"""What is not known of a region with holes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownScale:
    """A distance whose length is known, and what it says of the unit."""

    quantity: Quantity
    request: MeasurementRequest


def measure(
    specimen: Specimen, errors: Errors, requests: Requests
) -> tuple[list[Measurement], list[Measurement]]:
    """Measurements and checks, in their order.

    Where a known length sets the scale, a value of dimension p becomes ``v (L / D)^p`` with D the
    distance that was measured for it: its errors and those of v are of one model, and go together.
    """
    known = None
    if requests.scale_from is not None:
        known = KnownScale(
            quantity=quantity_of(specimen, requests.scale_from), request=requests.scale_from
        )
        assert requests.scale_from.length is not None
        share = requests.scale_from.sigma / requests.scale_from.length
        scale = ScaleError(sigma=share, name=f"known length ({requests.scale_from})")
        errors = replace(errors, scale=scale, unit="um")
    elif requests.checks and errors.unit == "px":
        raise InputError(
            f"check {requests.checks[0].name}: the project has no scale, its lengths are in px and "
            "cannot be compared with a known one: give --scale_from, or the pixel size to "
            "`semsfm reconstruct --pixel_size_um`"
        )
    found = [_measured(specimen, errors, one, known) for one in requests.measurements]
    checks = [_measured(specimen, errors, one, known) for one in requests.checks]
    return found, checks


def _measured(
    specimen: Specimen, errors: Errors, request: MeasurementRequest, known: KnownScale | None
) -> Measurement:
    if request.kind == "profile":
        return _profile(specimen, errors, request, known)
    quantity = _in_known_unit(quantity_of(specimen, request), known)
    compared = None if request.length is None else (float(request.length), float(request.sigma))
    return measurement(quantity, errors, request.name, str(request), known=compared)


def _in_known_unit(quantity: Quantity, known: KnownScale | None) -> Quantity:
    if known is None or quantity.dimension == 0:
        return quantity
    assert known.request.length is not None
    p = quantity.dimension
    factor = known.request.length / known.quantity.value
    facts = {
        k: v * factor ** (2 if k == "projected_area" else 1) for k, v in quantity.facts.items()
    }
    scaled = times(quantity, known.quantity, -p).scaled(known.request.length**p)
    return replace(scaled, facts=facts)


def quantity_of(specimen: Specimen, request: MeasurementRequest) -> Quantity:
    """What is asked for, in world units.

    Raises
    ------
    InputError
        A place or a region is not there, or does not give the value.

    """
    what = request.name
    spots = [place_of(specimen, place, what) for place in request.places]
    if request.kind == "distance":
        return distance(spots[0], spots[1], what)
    if request.kind == "angle":
        return angle(spots[0], spots[1], spots[2], what)
    whole = request.kind in WITHOUT_HOLES
    regions = [
        region_of(specimen, region, what, whole=whole and k == 0)
        for k, region in enumerate(request.regions)
    ]
    if request.kind == "volume" or request.kind in WITHOUT_HOLES:
        return _of_faces(specimen, request, regions)
    patches = [
        _joined_places(specimen, one, region, what)
        for one, region in zip(regions, request.regions, strict=True)
    ]
    if request.kind in ROUND:
        found = radius(request.kind, patches[0], what)
        return found.scaled(2.0) if request.diameter else found
    if request.kind == "plane_angle":
        return plane_angle(patches[0], patches[1], what)
    if request.kind == "point_to_plane":
        return point_to_plane(spots[0], patches[0], what)
    return step_height(patches[0], patches[1], what)


def _joined_places(specimen: Specimen, found: Region, region: RegionRequest, what: str) -> Places:
    if region.places:
        return Places.joined(*(place_of(specimen, place, what) for place in region.places))
    return at_vertices(specimen, found.vertices)


def _of_faces(specimen: Specimen, request: MeasurementRequest, regions: list[Region]) -> Quantity:
    assert specimen.mesh is not None
    inside = np.zeros(len(specimen.mesh.vertices), dtype=bool)
    inside[regions[0].vertices] = True
    corners = inside[specimen.mesh.faces].sum(axis=1)
    # a face across the border of a region is of it as far as its corners are
    touched = corners == 3 if request.kind == "volume" else corners > 0
    vertices, number = np.unique(specimen.mesh.faces[touched], return_inverse=True)
    faces = number.reshape(-1, 3).astype(np.int64)
    share = corners[touched] / 3.0
    patch = at_vertices(specimen, vertices)
    if request.kind == "volume":
        return closed_volume(patch, faces, request.name)
    if request.kind == "area":
        found = area(patch, faces, share, request.name)
    else:
        base = at_vertices(specimen, regions[1].vertices)
        found = volume_above(patch, faces, share, base, request.name)
    return replace(found, missing=regions[0].missing)


def place_of(specimen: Specimen, place: PlaceRequest, what: str) -> Places:
    """The place itself."""
    if place.vertex is not None:
        return at_vertex(specimen, place.vertex, what)
    return at_pixel(specimen, place.image, place.xy, what)


def region_of(
    specimen: Specimen, region: RegionRequest, what: str, *, whole: bool = False
) -> Region:
    """The vertices of a region; none for one that is made of places."""
    if region.places:
        return Region(vertices=np.zeros(0, dtype=np.int64))
    if specimen.mesh is None:
        raise InputError(f"{what}: there is no mesh: run `semsfm densify` and `semsfm mesh`")
    if region.union:
        return Region.union([region_of(specimen, one, what, whole=whole) for one in region.union])
    if region.label:
        return with_label(specimen, region.label, what)
    if not region.corners:
        return Region(vertices=np.arange(len(specimen.mesh.vertices)))
    (outline,) = region.outlines()
    corners = np.array([corner.xy for corner in outline])
    return in_polygon(specimen, outline[0].image, corners, what, whole=whole)


def _profile(
    specimen: Specimen, errors: Errors, request: MeasurementRequest, known: KnownScale | None
) -> Measurement:
    """Heights along a line: the value is the total height Pt, largest minus least."""
    a, b = request.places
    if a.vertex is not None or b.vertex is not None or a.image != b.image:
        raise InputError(
            f"{request.name}: a profile runs between two places in one image: give both as "
            "image:x,y of the same image"
        )
    if specimen.mesh is None:
        raise InputError(
            f"{request.name}: there is no mesh: run `semsfm densify` and `semsfm mesh`"
        )
    ends = place_of(specimen, a, request.name), place_of(specimen, b, request.name)
    distance(*ends, request.name)
    image = specimen.image_named(a.image)
    share = np.linspace(0.0, 1.0, request.samples)[:, None]
    source = (1.0 - share) * np.array(a.xy) + share * np.array(b.xy)
    hits = specimen.hits(image, specimen.prepared_pixel(image, source, request.name))
    missing = ~hits.found | hits.filled
    if missing.any():
        x, y = source[np.flatnonzero(missing)[0]]
        raise InputError(
            f"{request.name}: the line from {a} to {b} runs over a hole at {a.image}:{x:.0f},"
            f"{y:.0f}, where no surface was measured: choose a line beside it"
        )
    nowhere = np.full(len(share), -1, dtype=np.int64)
    samples = on_surface(specimen, hits.points, hits.normals, hits.vertices, nowhere)
    v = np.asarray(specimen.model.cameras.viewing_direction[image])
    heights = [_in_known_unit(q, known) for q in profile(ends, samples, v)]
    rows = tuple(
        (q.facts["along"], q.value, standard_uncertainty(errors.sources(q))) for q in heights
    )
    height = np.array([q.value for q in heights])
    low, high = heights[int(np.argmin(height))], heights[int(np.argmax(height))]
    total = Quantity(
        value=high.value - low.value,
        gradient=np.concatenate([high.gradient, -low.gradient]),
        places=Places.joined(high.places, low.places),
        dimension=1,
        facts={"length": _in_known_unit(distance(*ends, request.name), known).value},
    )
    return measurement(total, errors, request.name, f"total height of the {request}", profile=rows)
