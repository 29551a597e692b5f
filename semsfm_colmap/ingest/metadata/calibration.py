"""Pixel sizes that programs keep in a TIFF: OME-XML, ImageJ, DigitalMicrograph, resolution tags.

ImageJ writes ``unit=um`` into the description and pixels per unit into ``XResolution``; OME-XML has
``PhysicalSizeX`` with a unit, um where it names none; DigitalMicrograph a scale (tag 65009) and its
unit (65003). Resolution tags alone, per inch or per cm, count only where they are no printer's:
what programs write by default are 72 to 1200 dpi and a few round numbers above.
"""

from __future__ import annotations

import re
import struct

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.tags import (
    DESCRIPTION,
    DM_SCALE,
    DM_UNIT,
    RESOLUTION_UNIT,
    X_RESOLUTION,
)
from semsfm_colmap.ingest.metadata.text import (
    LENGTH_UM,
    decode,
    lines_of,
    number,
    positive,
)
from semsfm_colmap.ingest.metadata.xml import flatten_xml

PRINTER_DPI = (1440.0, 1800.0, 2400.0, 2540.0, 2880.0, 3600.0, 4800.0, 7200.0, 9600.0)
"""Round numbers of printers and scanners above `MAX_PRINTER_DPI`."""
MAX_PRINTER_DPI = 1200.0
INCH_UM = 25_400.0
UNIT_WORDS = {
    "micron": 1.0,
    "microns": 1.0,
    "micrometer": 1.0,
    "micrometre": 1.0,
    "micrometers": 1.0,
    "nanometer": 1e-3,
    "millimeter": 1e3,
    "inch": INCH_UM,
    "in": INCH_UM,
    "angstrom": 1e-4,
}
_ESCAPED = re.compile(r"\\u00([bB]5)|\\u03[bB][cC]")


def read(tags: dict[int, bytes], header: ImageHeader) -> MetadataReading | None:
    """A reading with the pixel size; None where no program recorded one."""
    description = decode(tags.get(DESCRIPTION, b""))
    for vendor, found in (
        ("OME", _ome(description)),
        ("ImageJ", _imagej(description, tags)),
        ("DigitalMicrograph", _digital_micrograph(tags)),
        ("TIFF resolution", _resolution(tags)),
    ):
        if found is not None:
            out = Collector(vendor)
            out.put("pixel_size_um", *found)
            return out.reading()
    return None


def unit_um(text: str) -> float | None:
    """The length of a unit in um, by any of its usual names."""
    word = _ESCAPED.sub("\u00b5", text.strip()).lower()
    return LENGTH_UM.get(word) or UNIT_WORDS.get(word)


def _ome(description: str) -> tuple[float, str] | None:
    if "<OME" not in description:
        return None
    values, problem = flatten_xml(description)
    size = positive(number(values.get("Image/Pixels@PhysicalSizeX")))
    unit = unit_um(values.get("Image/Pixels@PhysicalSizeXUnit", "um"))
    if problem or size is None or unit is None:
        return None
    return size * unit, "OME-XML PhysicalSizeX"


def _imagej(description: str, tags: dict[int, bytes]) -> tuple[float, str] | None:
    if not description.startswith("ImageJ="):
        return None
    values = dict(line.split("=", 1) for line in lines_of(description) if "=" in line)
    unit = unit_um(values.get("unit", ""))
    per_unit = _rational(tags.get(X_RESOLUTION, b""))
    if unit is None or per_unit is None:
        return None
    return unit / per_unit, "ImageJ unit, XResolution"


def _digital_micrograph(tags: dict[int, bytes]) -> tuple[float, str] | None:
    raw, unit = tags.get(DM_SCALE, b""), unit_um(decode(tags.get(DM_UNIT, b"")).strip("\x00"))
    if len(raw) != 8 or unit is None:
        return None
    scales = [struct.unpack(order + "d", raw)[0] for order in "<>"]
    usual = [scale for scale in scales if 1e-12 < scale < 1e12]
    return (usual[0] * unit, f"DigitalMicrograph {DM_SCALE}") if usual else None


def _resolution(tags: dict[int, bytes]) -> tuple[float, str] | None:
    raw = tags.get(RESOLUTION_UNIT, b"")[:2]
    kinds = {2: INCH_UM, 3: LENGTH_UM["cm"]}
    unit = kinds.get(int.from_bytes(raw, "little")) or kinds.get(int.from_bytes(raw, "big"))
    per_unit = _rational(tags.get(X_RESOLUTION, b""))
    if unit is None or per_unit is None:
        return None
    dpi = per_unit * INCH_UM / unit
    if dpi <= 1.001 * MAX_PRINTER_DPI or any(abs(dpi / p - 1) < 1e-3 for p in PRINTER_DPI):
        return None
    return unit / per_unit, "TIFF XResolution"


def _rational(raw: bytes) -> float | None:
    """A positive fraction of two 32-bit numbers, which `read_raw_tags` makes little-endian."""
    if len(raw) != 8:
        return None
    above, below = struct.unpack("<II", raw)
    return above / below if above and below else None
