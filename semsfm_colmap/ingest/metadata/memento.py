"""FEI's Memento: base64 of XML with nested items, in tag 34680 of some Sirion and Quanta files.

``<item><key><string>Scan</string></key><value>...`` nests sections; a value is ``<anyType>`` beside
its ``<MementoItemUnit>``. In SI units; radians.
"""

from __future__ import annotations

import base64
import binascii
import re

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector
from semsfm_colmap.ingest.metadata.text import MAX_ANGLE_RAD, decode, number, positive

_BASE64 = re.compile(r"[A-Za-z0-9+/\s]{64,}={0,2}\s*")
_TOKEN = re.compile(r"<(/?)(item|string|anyType|double|int)\b[^>]{0,400}>([^<]{0,400})")
MAX_TOKENS = 100_000
MAX_DEPTH = 32


def unpack(text: str) -> str | None:
    """The XML in base64; None where the text is nothing of that kind."""
    text = text.strip("\x00 \r\n\t")
    if not _BASE64.fullmatch(text):
        return None
    try:
        raw = base64.b64decode("".join(text.split()) + "==")
    except (binascii.Error, ValueError):
        return None
    unpacked = decode(raw)
    return unpacked if "<Memento" in unpacked else None


def flatten(xml: str) -> dict[str, str]:
    """``Scan/PixelSize/Width`` -> value. No tree is built, so that a cut file gives what it has."""
    values: dict[str, str] = {}
    keys: list[str] = []
    for count, found in enumerate(_TOKEN.finditer(xml)):
        closing, name, content = found.groups()
        if count > MAX_TOKENS or len(keys) > MAX_DEPTH:
            break
        if name == "item":
            if closing and keys:
                keys.pop()
            elif not closing:
                keys.append("")
        elif name == "string" and not closing and keys and not keys[-1]:
            keys[-1] = content.strip()
        elif not closing and content.strip() and keys:
            values.setdefault("/".join(keys), content.strip())
    return values


def read(xml: str, tag: str, header: ImageHeader, out: Collector) -> None:
    """Put what is known of the items into a reading; say so where nothing is."""
    values = flatten(xml)

    def at(*endings: str) -> tuple[float, str] | None:
        for ending in endings:
            for path, text in values.items():
                value = number(text)
                if f"/{path}".endswith(f"/{ending}") and value is not None:
                    return value, f"{tag} Memento {path}"
        return None

    size = at("Scan/PixelSize/Width", "PixelSize/Width", "Scan/PixelWidth")
    field = at("Scan/FieldSize/Width", "HorFieldsize", "HFW")
    if size and positive(size[0]):
        out.put("pixel_size_um", size[0] * 1e6, size[1])
    elif field and positive(field[0]):
        out.put("pixel_size_um", field[0] * 1e6 / header.width, f"{field[1]} / image width")
    for name, endings in (
        ("tilt_rad", ("Stage/T", "StageT", "Position/T")),
        ("stage_rotation_rad", ("Stage/R", "StageR", "Position/R")),
        ("scan_rotation_rad", ("Scan/Rotation", "ScanRotation")),
    ):
        angle = at(*endings)
        if angle and abs(angle[0]) <= MAX_ANGLE_RAD:
            out.put(name, *angle)
    for name, endings, factor in (
        ("working_distance_um", ("WorkingDistance", "WD"), 1e6),
        ("beam_energy_kev", ("HV", "AccelerationVoltage"), 1e-3),
    ):
        found = at(*endings)
        if found and found[0] > 0:
            out.put(name, found[0] * factor, found[1])
    if not out.values:
        out.warn(f"the base64 XML of {tag} holds nothing that is known: the header is not used")
