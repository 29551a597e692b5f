"""TESCAN: TIFF tag 50431, or a ``.hdr`` file beside the image with the same text.

The tag is a chain of records: length (4 bytes, counting the type), type (2 bytes), content. Type 1
is a thumbnail, 2 the text of section ``[MAIN]``, 3 that of ``[SEM]``; images of the ion beam have
``[FIB]``. Lengths are in metres,
voltages in volts; stage and scan angles are in degrees, unlike FEI's. ``ImageStripSize`` rows of
databar were added below the image when it was saved; ``PixelSizeX`` belongs to the saved image.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.text import (
    MAX_TEXT_BYTES,
    Sections,
    angle_rad,
    decode,
    number,
    positive,
    read_sections,
)

SECTION_OF_TYPE = {2: "MAIN", 3: "SEM", 4: "FIB"}
MAX_RECORDS = 64


def parse_tag(raw: bytes) -> dict[str, dict[str, str]]:
    """Sections of tag 50431; where its records are damaged, any ``key=value`` lines in it."""
    sections: dict[str, dict[str, str]] = {}
    position = 0
    for _ in range(MAX_RECORDS):
        if position + 6 > len(raw):
            break
        length, kind = struct.unpack_from("<IH", raw, position)
        if length < 2 or position + 4 + length > len(raw):
            break
        if kind in SECTION_OF_TYPE:
            content = raw[position + 6 : position + 4 + length]
            sections.setdefault(SECTION_OF_TYPE[kind], read_sections(decode(content))[""])
        position += 4 + length
    if sections:
        return sections
    start = raw.find(b"AccFrames=")
    if start < 0:
        return {}
    text = raw[start:MAX_TEXT_BYTES].decode("ascii", "replace").replace("\x00", "\n")
    found = read_sections(text)[""]
    return {"MAIN": found, "SEM": found}


def read(sections: Sections, source: str, header: ImageHeader) -> MetadataReading:
    """Metadata from the sections of the tag or of a ``.hdr`` file."""
    out = Collector("TESCAN")
    main = sections.get("MAIN", {})
    # an image of the ion beam has its block in the place of that of the electron beam
    block = "SEM" if sections.get("SEM") else "FIB"
    sem = sections.get(block, {})

    def at(section: str, key: str) -> str:
        section = block if section == "SEM" else section
        return f"{source} [{section}] {key}"

    strip = positive(number(main.get("ImageStripSize")))
    if strip is not None and strip < header.height:
        out.databar_rows = int(strip)
    pixel_um = positive(number(main.get("PixelSizeX")))
    pixel = (pixel_um * 1e6, at("MAIN", "PixelSizeX")) if pixel_um else None
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=header.image_rows,
        pixel=pixel,
        field_width=_field_width(main, source),
    )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    pixel_y = positive(number(main.get("PixelSizeY")))
    if pixel_um and pixel_y and abs(pixel_y / pixel_um - 1) > 1e-3:
        out.warn(f"pixels are not square ({pixel_um:.6g} x {pixel_y:.6g} m): the width is used")
    for name, key in (
        ("tilt_rad", "StageTilt"),
        ("stage_rotation_rad", "StageRotation"),
        ("scan_rotation_rad", "ScanRotation"),
    ):
        out.put(name, angle_rad(sem.get(key)), at("SEM", key))
    xyz = [number(sem.get(f"Stage{axis}")) for axis in "XYZ"]
    if xyz[0] is not None and xyz[1] is not None and xyz[2] is not None:
        metres = (xyz[0] * 1e6, xyz[1] * 1e6, xyz[2] * 1e6)
        out.put("stage_xyz_um", metres, at("SEM", "StageX, Y, Z"))
    distance = positive(number(sem.get("WD")))
    out.put("working_distance_um", distance and distance * 1e6, at("SEM", "WD"))
    for key in ("HV", "AcceleratorVoltage"):
        volts = positive(number(sem.get(key)))
        out.put("beam_energy_kev", volts and volts * 1e-3, at("SEM", key))
    magnification = positive(number(main.get("Magnification")))
    out.put("magnification", magnification, at("MAIN", "Magnification"))
    out.put("instrument", main.get("Device") or None, at("MAIN", "Device"))
    for key in ("Detector", "Detector0"):
        out.put("detector", sem.get(key) or None, at("SEM", key))
    correction = number(sem.get("TiltCorrection"))
    out.put(
        "tilt_corrected", None if correction is None else correction != 0,
        at("SEM", "TiltCorrection"),
    )  # fmt: skip
    return out.reading()


def _field_width(main: Mapping[str, str], source: str) -> tuple[float, str] | None:
    """Width of the field of view: a reference width (m) over the magnification."""
    reference = positive(number(main.get("MagnificationReference")))
    magnification = positive(number(main.get("Magnification")))
    if reference is None or magnification is None:
        return None
    return reference / magnification * 1e6, f"{source} [MAIN] MagnificationReference"
