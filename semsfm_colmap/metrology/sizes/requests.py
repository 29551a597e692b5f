"""What may be asked for: places, regions and measurements of them."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Literal

Kind = Literal[
    "distance", "angle", "plane_angle", "sphere", "cylinder", "circle", "point_to_plane",
    "step_height", "area", "volume", "volume_above", "profile",
]  # fmt: skip
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "distance": ("place", "place"),
    "angle": ("place", "place", "place"),
    "plane_angle": ("region", "region"),
    "sphere": ("region",),
    "cylinder": ("region",),
    "circle": ("region",),
    "point_to_plane": ("place", "region"),
    "step_height": ("region", "region"),
    "area": ("region",),
    "volume": ("region",),
    "volume_above": ("region", "region"),
    "profile": ("place", "place"),
}
"""What each kind of measurement is of. An angle's corner stands in the middle."""
ROUND = ("sphere", "cylinder", "circle")
DISC_CORNERS = 64
NUM_SAMPLES = 101
"""Samples of a profile unless it says otherwise."""


@dataclass(frozen=True, kw_only=True)
class PlaceRequest:
    """A pixel of an original image, or a vertex of the mesh."""

    image: str = ""
    xy: tuple[float, float] = (0.0, 0.0)
    vertex: int | None = None

    def __str__(self) -> str:
        if self.vertex is not None:
            return f"vertex:{self.vertex}"
        return f"{self.image}:{self.xy[0]:g},{self.xy[1]:g}"


@dataclass(frozen=True, kw_only=True)
class RegionRequest:
    """Vertices within a disc or a polygon of an image, of a label, of places, or all."""

    corners: tuple[PlaceRequest, ...] = ()
    radius_px: float = 0.0
    """above 0: a disc about the one corner"""
    label: str = ""
    places: tuple[PlaceRequest, ...] = ()
    """these very places, for a circle through some"""
    union: tuple[RegionRequest, ...] = ()
    """what lies in any of these"""

    def __str__(self) -> str:
        if self.places:
            return f"{len(self.places)} places"
        if self.union:
            return " and ".join(str(region) for region in self.union)
        if self.radius_px > 0.0:
            return f"disc of {self.radius_px:g} px about {self.corners[0]}"
        if self.corners:
            return f"polygon of {len(self.corners)} corners in {self.corners[0].image}"
        return f"part {self.label}" if self.label else "the whole surface"

    def outlines(self) -> list[tuple[PlaceRequest, ...]]:
        """Corners of what was drawn in images: a place by itself is one, a disc a polygon."""
        found: list[tuple[PlaceRequest, ...]] = [(place,) for place in self.places if place.image]
        for part in self.union:
            found += part.outlines()
        if self.radius_px > 0.0:
            found.append(tuple(disc_corners(self.corners[0], self.radius_px)))
        elif self.corners:
            found.append(self.corners)
        return found


def disc_corners(centre: PlaceRequest, radius_px: float) -> list[PlaceRequest]:
    """A disc as a polygon."""
    x, y = centre.xy
    angles = [2.0 * pi * k / DISC_CORNERS for k in range(DISC_CORNERS)]
    return [
        PlaceRequest(image=centre.image, xy=(x + radius_px * cos(a), y + radius_px * sin(a)))
        for a in angles
    ]


@dataclass(frozen=True, kw_only=True)
class MeasurementRequest:
    """One thing to measure."""

    name: str
    kind: Kind
    places: tuple[PlaceRequest, ...] = ()
    regions: tuple[RegionRequest, ...] = ()
    diameter: bool = False
    samples: int = NUM_SAMPLES
    length: float | None = None
    """a known value to compare with, world units"""
    sigma: float = 0.0
    """of the known value"""

    def __str__(self) -> str:
        of = ", ".join(str(part) for part in (*self.places, *self.regions))
        kind = self.kind.replace("_", " ")
        if self.kind in ROUND:
            kind += " diameter" if self.diameter else " radius"
        return f"{kind} of {of}"

    def outlines(self) -> list[tuple[PlaceRequest, ...]]:
        """Corners of what was drawn in images, a place by itself being one."""
        found: list[tuple[PlaceRequest, ...]] = [(place,) for place in self.places if place.image]
        for region in self.regions:
            found += region.outlines()
        return found


@dataclass(frozen=True, kw_only=True)
class Requests:
    """All of a file or of a command line."""

    measurements: tuple[MeasurementRequest, ...] = ()
    checks: tuple[MeasurementRequest, ...] = ()
    scale_from: MeasurementRequest | None = None
