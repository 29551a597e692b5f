"""What lies beside an MRC stack: tilt angles in .rawtlt, SerialEM's notes in .mdoc.

A .rawtlt file has the tilt in degrees of one section a line. An .mdoc file (SerialEM's manual,
"About .mdoc files") has ``key = value`` lines, global ones first, then a block after each
``[ZValue = k]``, k from 0; lines ``[T = ...]`` are titles, one of which says ``Tilt axis angle =``.

IMOD and SerialEM measure the tilt axis from the vertical, counterclockwise, with y up: an axis at r
degrees runs along (-sin r, cos r), which with y down is the direction 90 - r degrees from x toward
y.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.mrc import (
    ANGLES_SUFFIX,
    NOTES_SUFFIX,
    companion_files,
    read_stack_header,
    section_number,
)
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.text import decode
from semsfm_colmap.io.wording import one_line

MAX_BYTES = 16 << 20
"""A block of an .mdoc file has about 1 kB."""
MAX_TILT_DEG = 720.0
SAME_SIZE = 0.005
SAME_TILT_DEG = 0.5
_BLOCK = re.compile(r"\[\s*(\w+)\s*=\s*(.*?)\s*\]\s*$")
_TITLE_AXIS = re.compile(r"tilt axis angle\s*=\s*([-+.\w]+)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class StackNotes:
    """What the files beside a stack say."""

    tilt_deg: dict[int, float] = field(default_factory=dict)
    """By section."""
    tilt_source: str = ""
    pixel_size_um: float | None = None
    axis_from_vertical_deg: float | None = None
    notes_file: str = ""
    warnings: tuple[str, ...] = ()


def read_stack_notes(stack: Path, num_sections: int) -> StackNotes:
    """Read what lies beside a stack; .rawtlt has the last word on tilts.

    Every section asks: as long as the files are the same, they are read once.

    Raises
    ------
    InputError where a file does not belong to a stack of so many sections, or holds no numbers

    """
    files = tuple(companion_files(stack))
    state = tuple((s.st_ino, s.st_size, s.st_mtime_ns) for s in (path.stat() for path in files))
    return _read_notes(stack, num_sections, files, state)


@lru_cache(maxsize=8)
def _read_notes(
    stack: Path, num_sections: int, files: tuple[Path, ...], state: tuple[tuple[int, ...], ...]
) -> StackNotes:
    notes = StackNotes()
    mdoc = next((path for path in files if path.suffix == NOTES_SUFFIX), None)
    if mdoc is not None:
        notes = _read_mdoc(mdoc, stack, num_sections)
    rawtlt = next((path for path in files if path.suffix == ANGLES_SUFFIX), None)
    if rawtlt is None:
        return notes
    tilts = dict(enumerate(_read_rawtlt(rawtlt, stack, num_sections)))
    worst = max((abs(tilts[k] - tilt) for k, tilt in notes.tilt_deg.items()), default=0.0)
    warnings = notes.warnings
    if worst > SAME_TILT_DEG:
        warnings += (
            f"the tilts in {rawtlt.name} differ from those in {notes.notes_file} by up to "
            f"{worst:.2g} degrees; the former are used",
        )
    return StackNotes(
        tilt_deg=tilts,
        tilt_source=rawtlt.name,
        pixel_size_um=notes.pixel_size_um,
        axis_from_vertical_deg=notes.axis_from_vertical_deg,
        notes_file=notes.notes_file,
        warnings=warnings,
    )


def read_section(path: Path) -> MetadataReading:
    """Metadata of one section from the stack's header and the files beside it."""
    stack = path.parent
    header = read_stack_header(stack)
    notes = read_stack_notes(stack, header.num_sections)
    out = Collector("MRC")
    out.put("pixel_size_um", header.pixel_size_um, "MRC header")
    out.put("pixel_size_um", notes.pixel_size_um, f"{notes.notes_file} PixelSpacing")
    if header.pixel_size_um is not None and notes.pixel_size_um is not None:
        ratio = notes.pixel_size_um / header.pixel_size_um
        if abs(ratio - 1.0) > SAME_SIZE:
            out.warn(
                f"the header says {header.pixel_size_um:.6g} um a pixel but {notes.notes_file} "
                f"{notes.pixel_size_um:.6g}; the former is used, give pixel_size_um if it is wrong"
            )
    tilt = notes.tilt_deg.get(section_number(path))
    if tilt is not None:
        out.put("tilt_rad", math.radians(tilt), notes.tilt_source)
    else:
        out.warn(
            f"no tilt is known: neither {stack.with_suffix(ANGLES_SUFFIX).name} nor "
            f"{stack.name}{NOTES_SUFFIX} beside the stack gives one"
        )
    if notes.axis_from_vertical_deg is not None:
        axis = math.radians(90.0 - notes.axis_from_vertical_deg)
        out.put("tilt_axis_rad", axis, f"{notes.notes_file} tilt axis angle")
    for warning in notes.warnings:
        out.warn(warning)
    return out.reading()


def _read_rawtlt(path: Path, stack: Path, num_sections: int) -> list[float]:
    lines = [line.strip() for line in _text(path).splitlines() if line.strip()]
    if len(lines) != num_sections:
        raise InputError(
            f"{path} has {len(lines)} angles but {stack.name} has {num_sections} images: give one "
            "line an image, or take the file away to go without known tilts"
        )
    return [_angle(path, f"line {k + 1}", line) for k, line in enumerate(lines)]


def _read_mdoc(path: Path, stack: Path, num_sections: int) -> StackNotes:
    general: dict[str, str] = {}
    titles: list[str] = []
    sections: dict[int, dict[str, str]] = {}
    current = general
    for line in _text(path).splitlines():
        block = _BLOCK.match(line.strip())
        if block is None:
            key, equals, value = line.partition("=")
            if equals:
                current[key.strip()] = value.strip()
        elif block[1] == "ZValue" and block[2].isdecimal():
            current = sections.setdefault(int(block[2]), {})
        elif block[1] == "T":
            titles.append(block[2])
        else:  # frame sets, montages: of no section
            current = {}
    if sections and sorted(sections) != list(range(num_sections)):
        raise InputError(
            f"{path} describes {len(sections)} images, numbers {min(sections)} to "
            f"{max(sections)}, but {stack.name} has {num_sections}: give the .mdoc file of this "
            "stack, or take it away"
        )
    tilts = {
        k: _angle(path, f"image {k}", values["TiltAngle"])
        for k, values in sections.items()
        if "TiltAngle" in values
    }
    title_axes = [match[1] for title in titles if (match := _TITLE_AXIS.search(title))]
    axes = [general["TiltAxisAngle"]] if "TiltAxisAngle" in general else title_axes
    spacing = general.get("PixelSpacing")
    angstrom = None if spacing is None else _number(path, "PixelSpacing", spacing)
    return StackNotes(
        tilt_deg=tilts,
        tilt_source=f"{path.name} TiltAngle",
        pixel_size_um=angstrom * 1e-4 if angstrom is not None and angstrom > 0 else None,
        axis_from_vertical_deg=_angle(path, "the tilt axis angle", axes[0]) if axes else None,
        notes_file=path.name,
    )


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return decode(file.read(MAX_BYTES))
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); check its permissions"
        ) from error


def _number(path: Path, where: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}, {where}: {one_line(text, 40)!r} is not a number; correct it")
    return value


def _angle(path: Path, where: str, text: str) -> float:
    value = _number(path, where, text)
    if abs(value) > MAX_TILT_DEG:
        raise InputError(f"{path}, {where}: {value:g} is no angle in degrees; correct it")
    return value
