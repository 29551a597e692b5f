"""Phenom: XML ``<FeiImage>`` in TIFF tag 34683, or behind the end of a JPEG.

Lengths carry their unit as an attribute; ``databarHeight`` rows lie below the image where they were
saved with it.
"""

from __future__ import annotations

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.text import angle_rad, length_um, number, positive, voltage_kev
from semsfm_colmap.ingest.metadata.xml import flatten_xml

ROOT = "<FeiImage"


def read(text: str, source: str, header: ImageHeader) -> MetadataReading:
    """Metadata of a Phenom."""
    out = Collector("Phenom")
    start, end = text.find(ROOT), text.rfind("</FeiImage>")
    values, problem = flatten_xml(text[start : end + len("</FeiImage>")] if end > 0 else text)
    if problem:
        out.warn(f"the XML of the Phenom was not read: {problem}")
        return out.reading()
    tag = f"{source} "

    def united(path: str) -> str:
        return f"{values.get(path, '')} {values.get(path + '@unit', '')}"

    size = positive(length_um(united("pixelWidth")))
    height = positive(length_um(united("pixelHeight")))
    out.put("pixel_size_um", size, tag + "pixelWidth")
    if size and height and abs(height / size - 1) > 1e-3:
        out.warn(f"pixels are not square ({size:.6g} x {height:.6g} um): the width is used")
    bar = positive(number(values.get("databarHeight")))
    if bar is not None and bar < header.height:
        out.databar_rows = int(bar)
    out.put(
        "beam_energy_kev", voltage_kev(united("acquisition/scan/highVoltage")), tag + "highVoltage"
    )
    detector = values.get("acquisition/scan/detector")
    out.put("detector", detector or None, tag + "detector")
    distance = positive(length_um(united("workingDistance")))
    out.put("working_distance_um", distance, tag + "workingDistance")
    out.put("tilt_rad", angle_rad(united("samplePosition/tilt"), "rad"), tag + "tilt")
    name = values.get("instrument/edition") or values.get("instrument/type")
    out.put("instrument", name or None, tag + "instrument")
    return out.reading()
