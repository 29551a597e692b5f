"""JEOL: lines ``$CM_MAG 5000`` in a text file beside the image, or in the TIFF's description.

Lengths carry a unit or are in millimetres (working distance, stage); angles are in degrees, the
accelerating voltage in kV. The pixel size stands in ``$CM_FIELD_OF_VIEW`` or ``$CM_PIXEL_SIZE`` in
newer files, and follows from the scale bar in all: ``$$SM_MICRON_MARKER 5um`` is written at a bar
of ``$$SM_MICRON_BAR`` pixels. Keys come with one or two ``$``. The stage is
``$CM_STAGE_POSITION X=.., Y=.., R=.., Z=.., T=..`` or ``$CM_STAGE_POS x y z r t mode``.
"""

from __future__ import annotations

import re

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.text import (
    angle_rad,
    length_um,
    lines_of,
    number,
    number_and_unit,
    positive,
    voltage_kev,
)

_LINE = re.compile(r"\${1,2}((?:CM|SM|FE|GB|IP|PE)_[A-Z0-9_]{1,60})(?:\s+(.*))?")
_AXIS = re.compile(r"([XYZRT])\s*=\s*([-+0-9.eE]{1,30})")
FILM_MM = 128.0
"""JEOL's magnification is that of a photograph so wide."""
_ONE_UNIT = re.compile(r"([0-9.]{1,20})[\s,x*]+([0-9.]{1,20})\s*([^\s0-9.]{1,3})")
_TWO_LENGTHS = re.compile(r"([0-9.]{1,20}\s*[^\s0-9.]{1,3})[\s,x]+([0-9.]{1,20}\s*[^\s0-9.]{1,3})")


def parse(text: str) -> dict[str, str]:
    """``"$CM_MAG 5000"`` -> ``{"CM_MAG": "5000"}``."""
    values: dict[str, str] = {}
    for line in lines_of(text):
        found = _LINE.fullmatch(line)
        if found:
            values.setdefault(found[1], (found[2] or "").strip())
    return values


def read(values: dict[str, str], source: str, header: ImageHeader) -> MetadataReading:
    """Metadata from JEOL's lines."""
    out = Collector("JEOL")
    tag = f"{source} $"
    raster = None
    for key in ("CM_FULL_SIZE", "CM_IMAGE_SIZE"):
        sides = [number(part) for part in re.split(r"[\s,xX*]+", values.get(key, ""))[:2]]
        if len(sides) == 2 and sides[0] and sides[1] and min(sides[0], sides[1]) > 0:
            raster = (int(sides[0]), int(sides[1]))
            break
    bar = positive(number(values.get("SM_PNU_HEIGHT")))
    if raster and raster[0] == header.width and 0 < raster[1] < header.height:
        out.image_rows = raster[1]
    elif bar is not None and bar < header.height:
        out.databar_rows = int(bar)
    widths = _field(values.get("CM_FIELD_OF_VIEW", ""))
    out.scale_bar_um = positive(length_um(values.get("SM_MICRON_MARKER")))
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=out.image_rows,
        pixel=_pixel(values, out.scale_bar_um, tag),
        field_width=(widths[0], tag + "CM_FIELD_OF_VIEW") if widths[0] else None,
        field_height=(widths[1], tag + "CM_FIELD_OF_VIEW") if widths[1] else None,
        recorded_raster=raster,
        databar_rows=int(bar or 0),
    )
    magnification = positive(number(values.get("CM_MAG")))
    if size.um is None and magnification is not None:
        of = f"{tag}CM_MAG, {FILM_MM:g} mm wide"
        size = stored_pixel_size(
            width=header.width,
            height=header.height,
            image_rows=out.image_rows or header.image_rows,
            pixel=None,
            field_width=(FILM_MM * 1e3 / magnification, of),
            recorded_raster=raster,
            databar_rows=int(bar or 0),
        )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    _read_stage(values, tag, out)
    out.put(
        "scan_rotation_rad", angle_rad(values.get("SM_SCAN_ROTATION")), tag + "SM_SCAN_ROTATION"
    )
    distance = positive(length_um(values.get("SM_WD"), "mm"))
    out.put("working_distance_um", distance, tag + "SM_WD")
    for key in ("CM_ACCEL_VOLT", "CM_ACCEL_VOLTAGE"):
        out.put("beam_energy_kev", voltage_kev(values.get(key), "kv"), tag + key)
    out.put("magnification", magnification, tag + "CM_MAG")
    out.put("instrument", values.get("CM_INSTRUMENT") or None, tag + "CM_INSTRUMENT")
    for key in ("CM_SIGNAL_NAME", "CM_SIGNAL", "FE_DETECTOR_NAME"):
        out.put("detector", values.get(key) or None, tag + key)
    correction = values.get("SM_TILT_CORRECTION")
    if correction is not None:
        angle = number(correction)
        on = correction.strip().lower() in ("on", "yes", "true") or bool(angle)
        out.put("tilt_corrected", on, tag + "SM_TILT_CORRECTION")
    return out.reading()


def _field(text: str) -> list[float | None]:
    """Width and height of the field of view in um; one unit may hold for both."""
    found = _TWO_LENGTHS.match(text)
    if found:
        return [positive(length_um(part)) for part in found.groups()]
    found = _ONE_UNIT.match(text)
    if found:
        return [positive(length_um(f"{part} {found[3]}")) for part in found.groups()[:2]]
    return [None, None]


def _pixel(
    values: dict[str, str], scale_bar_um: float | None, tag: str
) -> tuple[float, str] | None:
    """The pixel size: written, or from the scale bar, which is a whole number of pixels long."""
    value, unit = number_and_unit(values.get("CM_PIXEL_SIZE"))
    if value:
        um = positive(length_um(f"{value} {unit.split('/')[0]}"))
        if um:
            return um, tag + "CM_PIXEL_SIZE"
    length_px = positive(number(values.get("SM_MICRON_BAR")))
    if scale_bar_um and length_px:
        return scale_bar_um / length_px, tag + "SM_MICRON_MARKER / SM_MICRON_BAR"
    return None


def _read_stage(values: dict[str, str], tag: str, out: Collector) -> None:
    """Stage position with or without the names of its axes; mm and degrees."""
    named = {
        axis: number(text) for axis, text in _AXIS.findall(values.get("CM_STAGE_POSITION", ""))
    }
    source = tag + "CM_STAGE_POSITION"
    if not named:
        for key in ("CM_STAGE_POS", "CM_STAGE_POSITION"):
            parts = [number(part) for part in values.get(key, "").split()]
            if len(parts) >= 5:
                named, source = dict(zip("XYZRT", parts, strict=False)), tag + key
                break
    if not named:
        return
    for name, axis in (("tilt_rad", "T"), ("stage_rotation_rad", "R")):
        degrees = named.get(axis)
        if degrees is not None:
            out.put(name, angle_rad(f"{degrees:.9g}"), f"{source} {axis}")
    x, y, z = named.get("X"), named.get("Y"), named.get("Z")
    if x is not None and y is not None and z is not None:
        out.put("stage_xyz_um", (x * 1e3, y * 1e3, z * 1e3), source)
