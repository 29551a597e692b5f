"""Numbers and sections from header texts, which are hostile until proven harmless.

Everything here is bounded: the length of a text, of a line and of a value, the size of a number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

MAX_TEXT_BYTES = 1 << 22
"""A header text longer than 4 MiB is cut: the longest real ones have 100 kB."""
MAX_LINE = 4096
MAX_NUMBER = 1e15
"""Larger magnitudes than this occur in no unit that a microscope writes."""
MIN_NUMBER = 1e-30
"""Smaller magnitudes are zero; they would only overflow when divided by."""
MAX_ANGLE_RAD = 4 * math.pi
_NUMBER = re.compile(r"[+-]?(?:\d{1,40}(?:[.,]\d{0,40})?|[.,]\d{1,40})(?:[eE][+-]?\d{1,4})?")

LENGTH_UM = {
    "m": 1e6,
    "cm": 1e4,
    "mm": 1e3,
    "um": 1.0,
    "\u00b5m": 1.0,
    "\u03bcm": 1.0,
    "nm": 1e-3,
    "pm": 1e-6,
    "\u00e5": 1e-4,
    "a": 1e-4,
}
VOLTAGE_KEV = {"v": 1e-3, "volt": 1e-3, "kv": 1.0, "mv": 1e-6, "ev": 1e-3, "kev": 1.0}

Sections = Mapping[str, Mapping[str, str]]


def decode(raw: bytes) -> str:
    """Header bytes as text: UTF-16 or UTF-8 if valid, else the code page of western Windows."""
    raw = raw[:MAX_TEXT_BYTES]
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", "replace")
    raw = raw.split(b"\x00\x00\x00\x00")[0].replace(b"\x00", b"")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # The Japanese code page writes a micro sign as 83 CA.
        return raw.replace(b"\x83\xca", b"\xb5").decode("cp1252", "replace")


def lines_of(text: str) -> Iterator[str]:
    """Lines ended by CR, LF or both, stripped and cut to a sane length."""
    for line in re.split(r"\r\n|\r|\n", text):
        yield line[:MAX_LINE].strip()


def read_sections(text: str, separator: str = "=") -> dict[str, dict[str, str]]:
    """``[Section]`` / ``key=value`` text; keys before the first section go to ``""``.

    A key that comes twice in a section keeps its first value.
    """
    sections: dict[str, dict[str, str]] = {"": {}}
    current = sections[""]
    for line in lines_of(text):
        if line.startswith("[") and line.endswith("]"):
            current = sections.setdefault(line[1:-1].strip(), {})
        elif separator in line:
            key, value = line.split(separator, 1)
            current.setdefault(key.strip(), value.strip())
    return sections


def number(text: str | None) -> float | None:
    """The number a value starts with, or None; absurdly large ones are None, tiny ones 0."""
    found = _NUMBER.match(text.strip()) if text else None
    if found is None:
        return None
    value = float(found.group().replace(",", "."))
    if not math.isfinite(value) or abs(value) > MAX_NUMBER:
        return None
    return value if abs(value) >= MIN_NUMBER else 0.0


def number_and_unit(text: str | None) -> tuple[float | None, str]:
    """``"5.825 nm"`` -> (5.825, "nm"); the unit is lower case and may be empty."""
    value = number(text)
    if value is None or text is None:
        return None, ""
    found = _NUMBER.match(text.strip())
    unit = text.strip()[found.end() :].strip() if found else ""
    return value, unit.lower()


def length_um(text: str | None, default_unit: str = "") -> float | None:
    """A length with its unit in micrometres; None without a known unit."""
    value, unit = number_and_unit(text)
    factor = LENGTH_UM.get(unit or default_unit)
    return None if value is None or factor is None else value * factor


def voltage_kev(text: str | None, default_unit: str = "") -> float | None:
    """A voltage with its unit in kV, which is the beam energy in keV."""
    value, unit = number_and_unit(text)
    factor = VOLTAGE_KEV.get(unit or default_unit)
    return positive(None if value is None or factor is None else value * factor)


def angle_rad(text: str | None, default_unit: str = "deg") -> float | None:
    """An angle with its unit in radians; None where it exceeds two turns or has another unit."""
    value, unit = number_and_unit(text)
    unit = unit or default_unit
    if value is None:
        return None
    if unit in ("deg", "degree", "degrees", "\u00b0"):
        value = math.radians(value)
    elif unit not in ("rad", "radian", "radians"):
        return None
    return value if abs(value) <= MAX_ANGLE_RAD else None


def positive(value: float | None) -> float | None:
    """The value where it is above zero: sizes, distances and energies are."""
    return value if value is not None and value > 0 else None


def flag(text: str | None) -> bool | None:
    """Yes/no, on/off, true/false, 1/0; None for anything else."""
    word = (text or "").strip().lower()
    if word in ("yes", "on", "true", "1"):
        return True
    if word in ("no", "off", "false", "0"):
        return False
    return None
