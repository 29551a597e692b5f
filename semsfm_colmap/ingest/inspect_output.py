"""An inspection as text, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import textwrap
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path

from semsfm_colmap.ingest.inspect import Inspection, InspectionRow
from semsfm_colmap.ingest.output import write_atomic

MAX_NAME = 32
MAX_CELL = 22
WIDTH = 100
_COLUMNS: tuple[tuple[str, Callable[[InspectionRow], object]], ...] = (
    ("file", lambda r: _shortened(r.name, MAX_NAME)),
    ("size", lambda r: f"{r.width} x {r.height}" if r.width and r.height else None),
    ("bits", lambda r: r.bits),
    ("um/px", lambda r: r.pixel_size_um),
    ("from", lambda r: r.pixel_size_source and _shortened(r.pixel_size_source, MAX_CELL)),
    ("tilt", lambda r: _rounded(r.tilt_deg)),
    ("rot", lambda r: _rounded(r.stage_rotation_deg)),
    ("disp um", lambda r: r.displacement_um),
    ("WD mm", lambda r: _rounded(r.working_distance_um and r.working_distance_um * 1e-3)),
    ("kV", lambda r: r.beam_energy_kev),
    ("detector", lambda r: r.detector and _shortened(r.detector, 10)),
    ("!", lambda r: len(r.warnings) or None),
)


FILE_FIELDS = tuple(f.name for f in fields(InspectionRow) if f.name != "displacement_um")
"""Fields of the JSON and CSV files."""


def format_inspection(inspection: Inspection) -> str:
    """A table for a terminal, the warnings by image, and the verdict."""
    cells = [[_text(get(row)) for _, get in _COLUMNS] for row in inspection.rows]
    titles = [title for title, _ in _COLUMNS]
    keep = [c for c in range(len(titles)) if c == 0 or any(line[c] != "-" for line in cells)]
    table = [[line[c] for c in keep] for line in [titles, *cells]]
    widths = [max(len(line[c]) for line in table) for c in range(len(keep))]
    lines = [
        "  ".join(
            cell.ljust(width) if c == 0 else cell.rjust(width)
            for c, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in table
    ]
    lines.insert(1, "-" * min(WIDTH, max(len(line) for line in lines)))
    lines += _remarks(inspection)
    lines.append("")
    for answer in inspection.answers:
        lines += _wrapped(f"{answer.question + '?':<20} {answer.answer}: {answer.reason}", 21)
    return "\n".join(lines) + "\n"


def write_inspection_json(inspection: Inspection, path: Path) -> None:
    """One object per image, with null where nothing is recorded."""
    rows = [{name: getattr(row, name) for name in FILE_FIELDS} for row in inspection.rows]
    text = json.dumps(rows, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(path, (text + "\n").encode())


def write_inspection_csv(inspection: Inspection, path: Path) -> None:
    """One line per image with the fields as columns; empty cells where nothing is recorded."""
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer)
    writer.writerow(FILE_FIELDS)
    for row in inspection.rows:
        values = asdict(row)
        values["warnings"] = "; ".join(row.warnings)
        writer.writerow(["" if values[name] is None else values[name] for name in FILE_FIELDS])
    write_atomic(path, buffer.getvalue().encode())


def _remarks(inspection: Inspection) -> list[str]:
    """Warnings of each image; one that many share is said once."""
    by_warning: dict[str, list[str]] = {}
    for row in inspection.rows:
        for warning in row.warnings:
            by_warning.setdefault(warning, []).append(row.name)
    lines = [""] if by_warning or inspection.remarks else []
    for warning, names in by_warning.items():
        who = names[0] if len(names) == 1 else f"{len(names)} images, from {names[0]}"
        if len(names) == len(inspection.rows) > 1:
            who = "all images"
        lines += _wrapped(f"{who}: {warning}", 2)
    for remark in inspection.remarks:
        lines += _wrapped(remark, 2)
    return lines


def _wrapped(text: str, indent: int) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def _text(value: object) -> str:
    if value is None or value == "":
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2) + 0.0  # no minus zero


def _shortened(text: str, limit: int) -> str:
    return text if len(text) <= limit else "…" + text[-(limit - 1) :]
