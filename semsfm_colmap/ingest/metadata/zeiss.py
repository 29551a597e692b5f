"""Zeiss SmartSEM: text in TIFF tag 34118, pairs of lines ``AP_WD`` / ``WD = 3.9 mm``.

``AP_PIXEL_SIZE`` is the pixel of a display 1024 px wide, whatever the stored image; the stored
pixel is ``AP_IMAGE_PIXEL_SIZE``, which older versions do not write, and in any case
``AP_WIDTH`` over the stored width. Before the pairs stand unnamed numbers in SI units, of which
the fourth is the display's pixel again, with more digits. Stage angles are in degrees.
"""

from __future__ import annotations

import re

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.scale import stored_pixel_size
from semsfm_colmap.ingest.metadata.tags import ZEISS
from semsfm_colmap.ingest.metadata.text import (
    angle_rad,
    decode,
    flag,
    length_um,
    lines_of,
    number,
    number_and_unit,
    positive,
    voltage_kev,
)

DISPLAY_WIDTH = 1024
"""Pixels that ``AP_PIXEL_SIZE`` refers to."""
ROUNDING = 1e-3
"""Headers show 4 digits."""
_KEY = re.compile(r"[A-Z]{2}_[A-Z0-9_]{1,60}")


def parse(raw: bytes) -> dict[str, str]:
    """``AP_WD`` -> ``"3.9 mm"`` for each pair of lines."""
    values: dict[str, str] = {}
    key = None
    for line in lines_of(decode(raw)):
        if _KEY.fullmatch(line):
            key = line
        elif key is not None:
            parts = re.split(r"\s*[=:]\s*", line, maxsplit=1)
            if len(parts) == 2:
                values.setdefault(key, parts[1].strip())
            key = None
    return values


def read(tags: dict[int, bytes], header: ImageHeader) -> MetadataReading:
    """Metadata of a Zeiss TIFF."""
    values = parse(tags[ZEISS])
    out = Collector("Zeiss")
    tag = "CZ_SEM "

    def sized(key: str) -> tuple[float, str] | None:
        um = positive(length_um(values.get(key)))
        return None if um is None else (um, tag + key)

    pixel = sized("AP_IMAGE_PIXEL_SIZE")
    field_width = _field_width(sized("AP_WIDTH"), sized("AP_PIXEL_SIZE"), tags[ZEISS])
    size = stored_pixel_size(
        width=header.width,
        height=header.height,
        image_rows=header.image_rows,
        pixel=pixel,
        field_width=field_width,
        field_height=sized("AP_HEIGHT"),
        recorded_raster=_raster(values.get("DP_IMAGE_STORE")),
    )
    out.put("pixel_size_um", size.um, size.source)
    if size.warning:
        out.warn(size.warning)
    for name, key in (("tilt_rad", "AP_STAGE_AT_T"), ("stage_rotation_rad", "AP_STAGE_AT_R")):
        out.put(name, angle_rad(values.get(key)), tag + key)
    scan_rotation = angle_rad(values.get("AP_SCANROTATION"))
    if flag(values.get("DP_SCAN_ROT")) is False:
        out.put("scan_rotation_rad", 0.0, tag + "DP_SCAN_ROT")
    out.put("scan_rotation_rad", scan_rotation, tag + "AP_SCANROTATION")
    xyz = [length_um(values.get(f"AP_STAGE_AT_{axis}")) for axis in "XYZ"]
    if None not in xyz:
        out.put("stage_xyz_um", tuple(xyz), tag + "AP_STAGE_AT_X, _Y, _Z")
    out.put("working_distance_um", positive(length_um(values.get("AP_WD"))), tag + "AP_WD")
    for key in ("AP_ACTUALKV", "AP_MANUALKV"):
        out.put("beam_energy_kev", voltage_kev(values.get(key)), tag + key)
    out.put("magnification", _magnification(values.get("AP_MAG")), tag + "AP_MAG")
    for name, keys in (
        ("instrument", ("DP_SEM", "SV_SERIAL_NUMBER")),
        ("detector", ("DP_DETECTOR_CHANNEL", "DP_DETECTOR_TYPE")),
    ):
        for key in keys:
            out.put(name, values.get(key) or None, tag + key)
    tilt_corrected = flag(values.get("DP_TILT_CORRECTION"))
    out.put("tilt_corrected", tilt_corrected, tag + "DP_TILT_CORRECTION")
    if flag(values.get("DP_DYNFOCUS")) or flag(values.get("DP_DYNAMIC_FOCUS")):
        out.warn("dynamic focus was on: the magnification varies across the tilted field")
    return out.reading()


def _field_width(
    written: tuple[float, str] | None, display_pixel: tuple[float, str] | None, raw: bytes
) -> tuple[float, str] | None:
    """Width of the field of view in um: the most precise of the places that agree on it."""
    source = f"CZ_SEM 4th number x {DISPLAY_WIDTH}"
    numbers = [number(line) for _, line in zip(range(4), lines_of(decode(raw)), strict=False)]
    if len(numbers) == 4 and numbers[3] is not None and 0 < numbers[3] < 1e-2:
        precise = numbers[3] * 1e6 * DISPLAY_WIDTH
        if written is None or abs(precise / written[0] - 1) <= ROUNDING:
            return precise, source
    if written is not None:
        return written
    if display_pixel is None:
        return None
    return display_pixel[0] * DISPLAY_WIDTH, f"{display_pixel[1]} x {DISPLAY_WIDTH}"


def _magnification(text: str | None) -> float | None:
    """``"50.00 K X"`` -> 50000."""
    value, unit = number_and_unit(text)
    if value is None:
        return None
    return positive(value * (1000.0 if unit.startswith("k") else 1.0))


def _raster(text: str | None) -> tuple[int, int] | None:
    """``"1024 * 768"`` -> (1024, 768)."""
    parts = [number(part) for part in (text or "").split("*")]
    if len(parts) != 2 or parts[0] is None or parts[1] is None:
        return None
    width, height = int(parts[0]), int(parts[1])
    return (width, height) if width > 0 and height > 0 else None
