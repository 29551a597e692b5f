"""Hitachi: a text file beside the image, ``[SemImageFile]`` with ``key=value`` lines.

``PixelSize`` is in nanometres and belongs to the raster ``DataSize``; stage coordinates are in
nanometres; other values carry their units (``WorkingDistance=8700 um``, ``AcceleratingVoltage=5000
Volt``). ``MicronMarker`` is what is written at the scale bar, in nanometres. Stage angles come
without a unit and in none that is publicly documented, so that only zero, or an angle with a unit,
is taken.
"""

from __future__ import annotations

import re

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.text import (
    Sections,
    angle_rad,
    length_um,
    number,
    number_and_unit,
    positive,
    voltage_kev,
)

SECTION = "SemImageFile"
_RASTER = re.compile(r"(\d{1,6})\s*[xX*]\s*(\d{1,6})")


def read(sections: Sections, source: str, header: ImageHeader) -> MetadataReading:
    """Metadata from a Hitachi text file."""
    values = sections[SECTION]
    out = Collector("Hitachi")
    tag = f"{source} "
    pixel_um = positive(length_um(values.get("PixelSize"), "nm"))
    found = _RASTER.match(values.get("DataSize", ""))
    raster = (int(found[1]), int(found[2])) if found else None
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=header.image_rows,
        pixel=(pixel_um, tag + "PixelSize") if pixel_um else None,
        field_width=None,
        recorded_raster=raster if raster and min(raster) > 0 else None,
    )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    for name, key in (
        ("tilt_rad", "StagePositionT"),
        ("stage_rotation_rad", "StagePositionR"),
        ("scan_rotation_rad", "ScanRotation"),
    ):
        angle, unit = number_and_unit(values.get(key))
        if angle is None:
            continue
        if angle == 0 or unit:
            out.put(name, angle_rad(values[key]) if unit else 0.0, tag + key)
        else:
            out.warn(
                f"{key}={values[key][:40]} has no unit and none is documented: it is not used, "
                "give tilt and rotation in a series file"
            )
    xyz = [length_um(values.get(f"StagePosition{axis}"), "nm") for axis in "XYZ"]
    if xyz[0] is not None and xyz[1] is not None and xyz[2] is not None:
        out.put("stage_xyz_um", (xyz[0], xyz[1], xyz[2]), tag + "StagePositionX, Y, Z")
    distance = positive(length_um(values.get("WorkingDistance"), "um"))
    out.put("working_distance_um", distance, tag + "WorkingDistance")
    energy = voltage_kev(values.get("AcceleratingVoltage"), "v")
    out.put("beam_energy_kev", energy, tag + "AcceleratingVoltage")
    magnification = positive(number(values.get("Magnification")))
    out.put("magnification", magnification, tag + "Magnification")
    for key in ("InstructName", "Instrument name"):
        out.put("instrument", values.get(key) or None, tag + key)
    out.put("detector", values.get("SignalName") or None, tag + "SignalName")
    out.scale_bar_um = positive(length_um(values.get("MicronMarker"), "nm"))
    return out.reading()
