"""OpenFIBSEM: JSON in the TIFF's description, in SI units: metres, volts, radians."""

from __future__ import annotations

import json
from typing import Any

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.text import MAX_ANGLE_RAD, number, positive


def parse(text: str) -> dict[str, Any]:
    """The JSON object of a description; empty where it is no image of OpenFIBSEM."""
    if not text.lstrip().startswith("{"):
        return {}
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    known = isinstance(content, dict) and "pixel_size" in content and "image" in content
    return content if known else {}


def read(content: dict[str, Any], header: ImageHeader) -> MetadataReading:
    """Metadata of an image of OpenFIBSEM."""
    out = Collector("OpenFIBSEM")
    tag = "OpenFIBSEM "

    def at(*path: str) -> float | None:
        value: Any = content
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return number(str(value))

    image = content.get("image")
    image = image if isinstance(image, dict) else {}
    resolution = image.get("resolution")
    raster = None
    if isinstance(resolution, list) and len(resolution) == 2:
        sides = [number(str(side)) for side in resolution]
        if sides[0] and sides[1] and min(sides[0], sides[1]) > 0:
            raster = (int(sides[0]), int(sides[1]))
    pixel, pixel_y = positive(at("pixel_size", "x")), positive(at("pixel_size", "y"))
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=header.image_rows,
        pixel=(pixel * 1e6, tag + "pixel_size") if pixel else None,
        field_width=None,
        recorded_raster=raster,
    )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    if pixel and pixel_y and abs(pixel_y / pixel - 1) > 1e-3:
        out.warn(f"pixels are not square ({pixel:.6g} x {pixel_y:.6g} m): the width is used")
    beam = "ion_beam" if "ION" in str(image.get("beam_type", "")).upper() else "electron_beam"
    state = "microscope_state"
    for name, path in (
        ("tilt_rad", (state, "stage_position", "t")),
        ("stage_rotation_rad", (state, "stage_position", "r")),
        ("scan_rotation_rad", (state, beam, "scan_rotation")),
    ):
        angle = at(*path)
        if angle is not None and abs(angle) <= MAX_ANGLE_RAD:
            out.put(name, angle, tag + path[-1])
    x, y, z = (at(state, "stage_position", axis) for axis in "xyz")
    if x is not None and y is not None and z is not None:
        out.put("stage_xyz_um", (x * 1e6, y * 1e6, z * 1e6), tag + "stage_position x, y, z")
    distance, volts = (
        positive(at(state, beam, "working_distance")),
        positive(at(state, beam, "voltage")),
    )
    out.put("working_distance_um", distance and distance * 1e6, tag + "working_distance")
    out.put("beam_energy_kev", volts and volts * 1e-3, tag + "voltage")
    info = content.get("system")
    info = info.get("info") if isinstance(info, dict) else None
    model = info.get("model") if isinstance(info, dict) else None
    out.put("instrument", model if isinstance(model, str) else None, tag + "model")
    return out.reading()
