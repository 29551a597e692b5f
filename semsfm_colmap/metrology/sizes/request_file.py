"""measurements.toml: places, regions and what to measure of them; validated, with line numbers.

    [places]
    left = "a.tif:512,300"                # image:x,y in px of the original image
    tip = "vertex:1234"                   # of mesh.ply

    [regions]
    top = { disc = "a.tif:400,200", radius_px = 40 }
    base = { polygon = ["a.tif:10,10", "a.tif:90,10", "a.tif:90,80"] }
    grain = { label = "specimen" }        # of `semsfm segment`
    plate = { union = ["base", { disc = "a.tif:700,80", radius_px = 30 }] }
    all = { everything = true }

    [measurements]
    width = { distance = ["left", "b.tif:530,310"] }
    step = { step_height = ["base", "top"] }
    ball = { sphere = "top" }             # the radius; with diameter = true twice that

    [checks]                              # known lengths: compared, never used
    bar = { distance = ["left", "tip"], length = 5.0, sigma = 0.02 }

    [scale_from]                          # a known length that sets the scale
    distance = ["left", "tip"]
    length = 5.0
    sigma = 0.02

Where a place or a region is asked for, its name or the thing itself may stand.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

from semsfm_colmap.errors import UsageError
from semsfm_colmap.metrology.sizes.requests import (
    ARGUMENTS,
    NUM_SAMPLES,
    ROUND,
    MeasurementRequest,
    PlaceRequest,
    RegionRequest,
    Requests,
)

SECTIONS = ("places", "regions", "measurements", "checks", "scale_from")


def parse_place(text: str, where: str) -> PlaceRequest:
    """``image:x,y`` or ``vertex:number``.

    Examples
    --------
    >>> parse_place("a.tif:512,300.5", "here")
    PlaceRequest(image='a.tif', xy=(512.0, 300.5), vertex=None)

    """
    head, _, tail = text.rpartition(":")
    if head == "vertex" and tail.isdecimal():
        return PlaceRequest(vertex=int(tail))
    number = r"[+-]?(?:\d+\.?\d*|\.\d+)"
    found = re.fullmatch(rf"\s*({number})\s*,\s*({number})\s*", tail)
    if not head or head == "vertex" or found is None:
        raise UsageError(
            f"{where}: {text!r} is no place: write image:x,y in px of the original image, such as "
            "a.tif:512,300, or vertex:1234"
        )
    return PlaceRequest(image=head, xy=(float(found[1]), float(found[2])))


def parse_known_length(text: str) -> MeasurementRequest:
    """``a,b,length[,sigma]`` of the command line, a and b places: ``a.tif:1,2,b.tif:3,4,5.0``.

    Examples
    --------
    >>> known = parse_known_length("a.tif:1,2,vertex:7,5.0,0.02")
    >>> known.length, known.sigma, str(known)
    (5.0, 0.02, 'distance of a.tif:1,2, vertex:7')

    """
    place = r"(?:vertex:\d+|[^,]+:[^,:]+,[^,]+)"
    found = re.fullmatch(rf"({place}),({place}),([^,]+)(?:,([^,]+))?", text)
    try:
        if found is None:
            raise ValueError
        length, sigma = float(found[3]), float(found[4] or 0.0)
    except ValueError:
        raise UsageError(
            f"--scale_from {text}: expected two places and a length, such as "
            "a.tif:10,20,a.tif:300,20,5.0, or with its standard deviation behind it"
        ) from None
    ends = tuple(parse_place(found[k], "--scale_from") for k in (1, 2))
    return _checked_length(
        MeasurementRequest(name="scale", kind="distance", places=ends, length=length, sigma=sigma),
        "--scale_from",
    )


def parse_requests(text: str, path: str) -> Requests:
    """The content of a measurements.toml.

    Raises
    ------
    UsageError
        What is wrong, and in which line.

    """
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error
    reader = _Reader(text=text, path=path)
    for key in content:
        if key not in SECTIONS:
            raise UsageError(f"{reader.at(key)}: unknown section {key}{_near(key, SECTIONS)}")
        if not isinstance(content[key], dict):
            raise UsageError(f"{reader.at(key)}: {key} is a section: write [{key}]")
    reader = _Reader(
        text=text,
        path=path,
        places=content.get("places", {}),
        regions=content.get("regions", {}),
    )
    for name, value in reader.places.items():
        reader.place(value, reader.at("places", name))
    for name, value in reader.regions.items():
        reader.region(value, reader.at("regions", name))
    scale = content.get("scale_from")
    return Requests(
        measurements=tuple(
            reader.measurement(name, entry, reader.at("measurements", name))
            for name, entry in content.get("measurements", {}).items()
        ),
        checks=tuple(
            reader.measurement(name, entry, reader.at("checks", name), known=True)
            for name, entry in content.get("checks", {}).items()
        ),
        scale_from=None
        if scale is None
        else reader.measurement("scale", scale, reader.at("scale_from"), known=True),
    )


@dataclass(frozen=True, kw_only=True)
class _Reader:
    """The text, for its lines, and the names it defines."""

    text: str
    path: str
    places: Mapping[str, Any] = field(default_factory=dict)
    regions: Mapping[str, Any] = field(default_factory=dict)

    def at(self, section: str, name: str = "") -> str:
        """Path, line and name of an entry, for a message."""
        heads = {f"[{section}.{name}]", f'[{section}."{name}"]'} if name else {f"[{section}]"}
        whole = f"{section}.{name}" if name else section
        within = False
        for number, line in enumerate(self.text.splitlines(), 1):
            bare = line.split("#")[0].strip()
            if bare.startswith("["):
                within = bare == f"[{section}]"
            key = bare.split("=")[0].strip().strip("\"'")
            own = within and key == name if name else key.split(".")[0] == section
            if bare in heads or own:
                return f"{self.path}, line {number}: {whole}"
        return f"{self.path}: {whole}"

    def place(self, value: Any, where: str) -> PlaceRequest:
        """A place or the name of one."""
        if not isinstance(value, str):
            raise UsageError(f"{where}: {value!r} is no place: write a text such as a.tif:512,300")
        if value in self.places and isinstance(self.places[value], str):
            return parse_place(self.places[value], where)
        if ":" not in value:
            raise UsageError(
                f"{where}: no place is called {value}{_near(value, self.places)}: "
                f"define it below [places], or write image:x,y"
            )
        return parse_place(value, where)

    def region(self, value: Any, where: str) -> RegionRequest:
        """A region or the name of one."""
        if isinstance(value, str):
            if value not in self.regions or isinstance(self.regions[value], str):
                raise UsageError(
                    f"{where}: no region is called {value}{_near(value, self.regions)}: define it "
                    "below [regions]"
                )
            # what it is made of may be any other region: none that is made of itself
            others = {name: one for name, one in self.regions.items() if name != value}
            return replace(self, regions=others).region(self.regions[value], where)
        if isinstance(value, list):
            return RegionRequest(places=tuple(self.place(one, where) for one in value))
        kinds = ("disc", "polygon", "label", "union", "everything")
        if not isinstance(value, dict) or len(found := [k for k in kinds if k in value]) != 1:
            raise UsageError(f"{where} must name one of {', '.join(kinds)}, but is {value!r}")
        kind = found[0]
        unknown = set(value) - {kind, *(("radius_px",) if kind == "disc" else ())}
        if unknown:
            raise UsageError(f"{where}: unknown key {min(unknown)}")
        if kind == "disc":
            radius = value.get("radius_px")
            if not isinstance(radius, (int, float)) or isinstance(radius, bool) or radius <= 0.0:
                raise UsageError(f"{where}: a disc needs radius_px, a positive number of px")
            centre = self.pixel(value["disc"], where)
            return RegionRequest(corners=(centre,), radius_px=float(radius))
        if kind == "polygon":
            if not isinstance(value["polygon"], list) or len(value["polygon"]) < 3:
                raise UsageError(f"{where}: polygon is a list of 3 places or more in one image")
            corners = tuple(self.pixel(one, where) for one in value["polygon"])
            if len({corner.image for corner in corners}) > 1:
                raise UsageError(f"{where}: the corners of a polygon are places in one image")
            return RegionRequest(corners=corners)
        if kind == "union":
            if not isinstance(value["union"], list) or not value["union"]:
                raise UsageError(f"{where}: union is a list of regions")
            return RegionRequest(union=tuple(self.region(one, where) for one in value["union"]))
        if kind == "label":
            if not isinstance(value["label"], str):
                raise UsageError(f"{where}: label is the name of a part")
            return RegionRequest(label=value["label"])
        if value["everything"] is not True:
            raise UsageError(f"{where}: everything is true, or left out")
        return RegionRequest()

    def pixel(self, value: Any, where: str) -> PlaceRequest:
        """A place that is picked in an image."""
        found = self.place(value, where)
        if found.vertex is not None:
            raise UsageError(f"{where}: {value} is a vertex: give a place in an image")
        return found

    def measurement(
        self, name: str, entry: Any, where: str, *, known: bool = False
    ) -> MeasurementRequest:
        """One entry of [measurements] or [checks]."""
        if not isinstance(entry, dict) or len(found := [k for k in ARGUMENTS if k in entry]) != 1:
            raise UsageError(f"{where} must name one of {', '.join(ARGUMENTS)}, but is {entry!r}")
        kind = found[0]
        allowed = {kind}
        allowed |= {"length", "sigma"} if known else set()
        allowed |= {"diameter"} if kind in ROUND else set()
        allowed |= {"samples"} if kind == "profile" else set()
        unknown = set(entry) - allowed
        if unknown:
            raise UsageError(f"{where}: unknown key {min(unknown)}{_near(min(unknown), allowed)}")
        if known and kind != "distance":
            raise UsageError(f"{where}: a known length is one of a distance")
        value, wanted = entry[kind], ARGUMENTS[kind]
        if kind == "circle" and isinstance(value, list):
            value = [value]
        values = value if isinstance(value, list) else [value]
        if len(values) != len(wanted):
            raise UsageError(
                f"{where}: {kind} takes {len(wanted)} of {', '.join(wanted)}, not {len(values)}"
            )
        places, regions = [], []
        for one, what in zip(values, wanted, strict=True):
            if what == "place":
                places.append(self.place(one, where))
            else:
                regions.append(self.region(one, where))
        samples, diameter = entry.get("samples", NUM_SAMPLES), entry.get("diameter", False)
        if not isinstance(samples, int) or isinstance(samples, bool) or samples < 3:
            raise UsageError(f"{where}: samples is a number of 3 or more")
        if not isinstance(diameter, bool):
            raise UsageError(f"{where}: diameter is true or false")
        request = MeasurementRequest(
            name=name,
            kind=kind,  # type: ignore[arg-type]
            places=tuple(places),
            regions=tuple(regions),
            diameter=diameter,
            samples=samples,
            length=entry.get("length"),
            sigma=entry.get("sigma", 0.0),
        )
        return _checked_length(request, where) if known else request


def _checked_length(request: MeasurementRequest, where: str) -> MeasurementRequest:
    for value, name in ((request.length, "length"), (request.sigma, "sigma")):
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0.0 <= value < inf:
            raise UsageError(f"{where}: {name} = {value!r}, but a positive number is expected")
    if request.length == 0.0:
        raise UsageError(f"{where}: the known length is 0: give a positive one")
    return request


def _near(word: str, known: Any) -> str:
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]}?)" if near else ""
