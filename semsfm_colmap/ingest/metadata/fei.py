"""FEI and Thermo Fisher: sections of ``key=value`` in TIFF tag 34680 or 34682, XML in 34683.

SI units throughout: metres, volts, and radians for the stage and the scan. The databar lies below
the ``ResolutionY`` rows of the scan. Where a section is missing (exports drop some), the beam's
own section is used.
"""

from __future__ import annotations

import re

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata import memento
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.tags import FEI_HELIOS, FEI_SFEG, FEI_XML
from semsfm_colmap.ingest.metadata.text import (
    MAX_ANGLE_RAD,
    Sections,
    decode,
    flag,
    number,
    positive,
    read_sections,
)
from semsfm_colmap.ingest.metadata.xml import flatten_xml

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9]{0,30}")


def read(tags: dict[int, bytes], header: ImageHeader) -> MetadataReading:
    """Metadata of an FEI TIFF: the text tag first, the XML for what it lacks."""
    out = Collector("FEI")
    for code in (FEI_HELIOS, FEI_SFEG):
        text = decode(tags.get(code, b""))
        unpacked = memento.unpack(text)
        if unpacked is not None:
            memento.read(unpacked, f"FEI {code}", header, out)
        elif text:
            read_text(text, f"FEI {code}", header, out)
    if FEI_XML in tags:
        read_xml(decode(tags[FEI_XML]), header, out)
    return out.reading()


def read_text(text: str, tag: str, header: ImageHeader, out: Collector) -> None:
    """The ``[Section]`` text of tags 34680 and 34682."""
    sections = read_sections(text)
    beam = _word(sections, "Beam", "Beam") or ("IBeam" if "IBeam" in sections else "EBeam")
    scan = _word(sections, "Beam", "Scan") or ("IScan" if "IScan" in sections else "EScan")

    def si(
        *places: tuple[str, str], factor: float = 1.0, above_zero: bool = False
    ) -> tuple[float, str] | None:
        for section, key in places:
            value = number(sections.get(section, {}).get(key))
            if value is not None and (value > 0 or not above_zero):
                return value * factor, f"{tag} [{section}] {key}"
        return None

    columns = si(("Image", "ResolutionX"), above_zero=True)
    rows = si(("Image", "ResolutionY"), above_zero=True)
    raster = (int(columns[0]), int(rows[0])) if columns and rows else None
    databar = si(("PrivateFei", "DatabarHeight"), above_zero=True)
    if raster and raster[0] == header.width and 0 < raster[1] < header.height:
        out.image_rows = raster[1]
    pixel = si((scan, "PixelWidth"), ("Scan", "PixelWidth"), factor=1e6, above_zero=True)
    pixel_y = si((scan, "PixelHeight"), ("Scan", "PixelHeight"), factor=1e6, above_zero=True)
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=out.image_rows or header.image_rows,
        pixel=pixel,
        field_width=si(
            (scan, "HorFieldsize"), ("Scan", "HorFieldsize"), (beam, "HFW"), factor=1e6,
            above_zero=True,
        ),
        field_height=si(
            (scan, "VerFieldsize"), ("Scan", "VerFieldsize"), (beam, "VFW"), factor=1e6,
            above_zero=True,
        ),
        recorded_raster=raster,
        databar_rows=int(databar[0]) if databar and databar[0] < 1e5 else 0,
    )  # fmt: skip
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    if pixel and pixel_y and abs(pixel_y[0] / pixel[0] - 1) > 1e-3:
        out.warn(f"pixels are not square ({pixel[0]:.6g} x {pixel_y[0]:.6g} um): the width is used")
    for name, places in (
        ("tilt_rad", (("Stage", "StageT"), (beam, "StageTa"))),
        ("stage_rotation_rad", (("Stage", "StageR"), (beam, "StageR"))),
        ("scan_rotation_rad", (("Beam", "ScanRotation"), (beam, "ScanRotation"))),
    ):
        angle = si(*places)
        if angle and abs(angle[0]) <= MAX_ANGLE_RAD:
            out.put(name, *angle)
        elif angle:
            out.warn(f"{angle[1]} = {angle[0]:g} is no angle in radians: it is not used")
    xyz = [si(("Stage", f"Stage{a}"), (beam, f"Stage{a}"), factor=1e6) for a in "XYZ"]
    if xyz[0] and xyz[1] and xyz[2]:
        out.put("stage_xyz_um", (xyz[0][0], xyz[1][0], xyz[2][0]), xyz[0][1] + ", Y, Z")
    distance = si((beam, "WD"), ("Stage", "WorkingDistance"), factor=1e6, above_zero=True)
    energy = si((beam, "HV"), ("Beam", "HV"), factor=1e-3, above_zero=True)
    if distance:
        out.put("working_distance_um", *distance)
    if energy:
        out.put("beam_energy_kev", *energy)
    canvas = si(("Image", "MagCanvasRealWidth"), above_zero=True)
    field = si((beam, "HFW"), (scan, "HorFieldsize"), above_zero=True)
    if canvas and field:
        out.put("magnification", canvas[0] / field[0], f"{canvas[1]} / {field[1]}")
    for name, section, key in (
        ("instrument", "System", "SystemType"),
        ("detector", "Detectors", "Name"),
    ):
        text_value = sections.get(section, {}).get(key)
        out.put(name, text_value or None, f"{tag} [{section}] {key}")
    corrected = flag(sections.get(beam, {}).get("TiltCorrectionIsOn"))
    out.put("tilt_corrected", corrected, f"{tag} [{beam}] TiltCorrectionIsOn")
    if flag(sections.get(beam, {}).get("DynamicFocusIsOn")):
        out.warn("dynamic focus was on: the magnification varies across the tilted field")


def read_xml(text: str, header: ImageHeader, out: Collector) -> None:
    """The XML of tag 34683."""
    values, problem = flatten_xml(text)
    if problem:
        out.warn(f"the XML of tag {FEI_XML} was not read: {problem}")
        return
    tag = f"FEI {FEI_XML} "

    def si(path: str, factor: float = 1.0, above_zero: bool = False) -> tuple[float, str] | None:
        value = number(values.get(path))
        if value is None or (above_zero and value <= 0):
            return None
        return value * factor, tag + path

    width = si("ScanSettings/ScanSize/Width", above_zero=True)
    height = si("ScanSettings/ScanSize/Height", above_zero=True)
    raster = (int(width[0]), int(height[0])) if width and height else None
    if out.image_rows is None and raster and raster[0] == header.width < 1 << 31:
        out.image_rows = raster[1] if 0 < raster[1] < header.height else None
    if "pixel_size_um" not in out.values:
        size = stored_pixel_size(
            width=header.width,
            height=header.height,
            image_rows=out.image_rows,
            pixel=si("BinaryResult/PixelSize/X", 1e6, True),
            field_width=si("Optics/ScanFieldOfView/X", 1e6, True),
            field_height=si("Optics/ScanFieldOfView/Y", 1e6, True),
            recorded_raster=raster,
        )
        out.put("pixel_size_um", size.um, size.source)
        if size.warning:
            out.warn(size.warning)
    position = "StageSettings/StagePosition/"
    for name, path in (
        ("tilt_rad", position + "Tilt/Alpha"),
        ("stage_rotation_rad", position + "Rotation"),
        ("scan_rotation_rad", "ScanSettings/ScanRotation"),
    ):
        angle = si(path)
        if angle and abs(angle[0]) <= MAX_ANGLE_RAD:
            out.put(name, *angle)
    xyz = [si(position + axis, 1e6) for axis in "XYZ"]
    if xyz[0] and xyz[1] and xyz[2]:
        out.put("stage_xyz_um", (xyz[0][0], xyz[1][0], xyz[2][0]), tag + position + "X, Y, Z")
    for name, path, factor in (
        ("working_distance_um", "Optics/WorkingDistance", 1e6),
        ("beam_energy_kev", "Optics/AccelerationVoltage", 1e-3),
    ):
        found = si(path, factor, True)
        if found:
            out.put(name, positive(found[0]), found[1])
    for name, path in (
        ("instrument", "Instrument/InstrumentClass"),
        ("detector", "Detectors/ScanningDetector/DetectorName"),
    ):
        out.put(name, values.get(path) or None, tag + path)
    path = "Optics/SampleTiltCorrectionOn"
    out.put("tilt_corrected", flag(values.get(path)), tag + path)


def _word(sections: Sections, section: str, key: str) -> str | None:
    value = sections.get(section, {}).get(key, "")
    return value if _WORD.fullmatch(value) else None
