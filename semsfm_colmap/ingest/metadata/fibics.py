"""Fibics, whose engine is in ZEISS Atlas: XML ``<Fibics>`` in TIFF tag 51023, with units."""

from __future__ import annotations

import math

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.text import angle_rad, length_um, number, positive, voltage_kev
from semsfm_colmap.ingest.metadata.xml import flatten_xml


def read(text: str, header: ImageHeader) -> MetadataReading:
    """Metadata of an image of Fibics or Atlas."""
    out = Collector("Fibics")
    values, problem = flatten_xml(text)
    if problem:
        out.warn(f"the XML of tag 51023 was not read: {problem}")
        return out.reading()
    tag = "Fibics "

    def united(path: str, unit: str) -> str:
        return f"{values.get(path, '')} {values.get(path + '@units', unit)}"

    width = positive(length_um(united("Scan/FOV_X", "um")))
    height = positive(length_um(united("Scan/FOV_Y", "um")))
    step = [number(values.get(f"Scan/{axis}")) for axis in ("Ux", "Uy")]
    pixel = math.hypot(step[0], step[1]) if step[0] is not None and step[1] is not None else 0.0
    sides = [positive(number(values.get(f"Image/{side}"))) for side in ("Width", "Height")]
    raster = (int(sides[0]), int(sides[1])) if sides[0] and sides[1] else None
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=header.image_rows,
        pixel=(pixel, tag + "Ux, Uy") if pixel > 0 else None,
        field_width=(width, tag + "FOV_X") if width else None,
        field_height=(height, tag + "FOV_Y") if height else None,
        recorded_raster=raster,
    )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    for name, path in (
        ("tilt_rad", "Stage/Tilt"),
        ("stage_rotation_rad", "Stage/Rot"),
        ("scan_rotation_rad", "Scan/ScanRot"),
    ):
        out.put(name, angle_rad(united(path, "deg")), tag + path)
    xyz = [length_um(united(f"Stage/{axis}", "um")) for axis in "XYZ"]
    if xyz[0] is not None and xyz[1] is not None and xyz[2] is not None:
        out.put("stage_xyz_um", (xyz[0], xyz[1], xyz[2]), tag + "Stage X, Y, Z")
    for path in ("Beam/WD", "BeamInfo/WD"):
        distance = positive(length_um(united(path, "um")))
        out.put("working_distance_um", distance, tag + path)
    out.put("beam_energy_kev", voltage_kev(united("Beam/EHT", "v")), tag + "EHT")
    out.put("detector", values.get("DetectorInfo/item") or None, tag + "DetectorInfo")
    return out.reading()
