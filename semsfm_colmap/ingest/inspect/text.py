"""An inspection as text for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

from semsfm_colmap.ingest.inspect.inspection import Inspection
from semsfm_colmap.ingest.inspect.rows import InspectionRow

WIDTH = 100
"""Columns of the text where the terminal does not say."""
MIN_WIDTH, MAX_WIDTH = 60, 160
GAP = "  "
STEPS = 6
"""In how many steps long cells are shortened."""
_COLUMNS: tuple[tuple[str, Callable[[InspectionRow], object]], ...] = (
    ("file", lambda r: r.name),
    ("size", lambda r: f"{r.width} x {r.height}" if r.width and r.height else None),
    ("bits", lambda r: r.bits),
    ("pages", lambda r: r.num_pages if r.num_pages > 1 else None),
    ("um/px", lambda r: r.pixel_size_um),
    ("from", lambda r: r.pixel_size_source),
    ("tilt", lambda r: _rounded(r.tilt_deg)),
    ("rot", lambda r: _rounded(r.stage_rotation_deg)),
    ("scan", lambda r: _rounded(r.scan_rotation_deg) or None),
    ("disp um", lambda r: r.displacement_um),
    ("WD mm", lambda r: _rounded(r.working_distance_um and r.working_distance_um * 1e-3)),
    ("kV", lambda r: r.beam_energy_kev),
    ("detector", lambda r: r.detector),
    ("kept", lambda r: f"{r.kept[0]} x {r.kept[1]}" if r.kept else None),
    ("!", lambda r: len(r.warnings) or None),
)
_LIMITS = {"file": (32, 16), "from": (36, 10), "detector": (10, 6)}
"""Longest cells of the columns that hold text, where there is room and where there is none."""


def format_inspection(inspection: Inspection, width: int = WIDTH) -> str:
    """A table for a terminal, the warnings by image, and the verdict, in lines of `width`.

    Columns without any value are left out. Where the table is too wide, what all images have in
    common is said once above it, then long cells are shortened, and what still does not fit goes
    into a second table.
    """
    width = min(max(width, MIN_WIDTH), MAX_WIDTH)
    columns = {title: [_text(get(row)) for row in inspection.rows] for title, get in _COLUMNS}
    columns = {k: v for k, v in columns.items() if k == "file" or any(c != "-" for c in v)}
    lines = []
    if _total(_shorten(columns, 0)) > width and len(inspection.rows) > 1:
        common = [k for k, v in columns.items() if k not in ("file", "!") and len(set(v)) == 1]
        if common:
            said = ", ".join(f"{title} {columns.pop(title)[0]}" for title in common)
            lines += [*_wrapped(f"all images: {said}", 2, width), ""]
    layouts = [_blocks(_shorten(columns, step), width) for step in range(STEPS + 1)]
    for block in min(layouts, key=len):
        lines += [*_table(block), ""]
    lines = lines[:-1] + _remarks(inspection, width)
    lines.append("")
    for answer in inspection.answers:
        text = f"{answer.question + '?':<20} {answer.answer}: {answer.reason}"
        lines += _wrapped(text, 21, width)
    return "\n".join(lines) + "\n"


def _shorten(columns: dict[str, list[str]], step: int) -> dict[str, list[str]]:
    """Cells cut to lengths that go from the larger limit to the smaller one in `STEPS` steps."""
    out = {}
    for title, cells in columns.items():
        if title in _LIMITS:
            long, short = _LIMITS[title]
            limit = long - (long - short) * step // STEPS
            cells = [_shortened(cell, limit) for cell in cells]
        out[title] = cells
    return out


def _total(columns: dict[str, list[str]]) -> int:
    """Width of a table."""
    widths = [max(map(len, (title, *cells))) for title, cells in columns.items()]
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _blocks(columns: dict[str, list[str]], width: int) -> list[dict[str, list[str]]]:
    """The table in pieces that fit, each of which begins with the file."""
    blocks = [{"file": columns["file"]}]
    for title, cells in columns.items():
        if title == "file":
            continue
        if _total({**blocks[-1], title: cells}) > width and len(blocks[-1]) > 1:
            blocks.append({"file": columns["file"]})
        blocks[-1][title] = cells
    return blocks


def _table(columns: dict[str, list[str]]) -> list[str]:
    """Titles, a rule, and a line per image."""
    widths = {title: max(map(len, (title, *cells))) for title, cells in columns.items()}
    rows = [list(columns), *(list(row) for row in zip(*columns.values(), strict=True))]
    lines = [
        GAP.join(
            cell.ljust(w) if c == 0 else cell.rjust(w)
            for c, (cell, w) in enumerate(zip(row, widths.values(), strict=True))
        ).rstrip()
        for row in rows
    ]
    lines.insert(1, "-" * _total(columns))
    return lines


def _remarks(inspection: Inspection, width: int) -> list[str]:
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
        lines += _wrapped(f"{who}: {warning}", 2, width)
    for remark in inspection.remarks:
        lines += _wrapped(remark, 2, width)
    return lines


def _wrapped(text: str, indent: int, width: int) -> list[str]:
    return textwrap.wrap(
        text, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def _text(value: object) -> str:
    if value is None or value == "":
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2) + 0.0  # no minus zero


def _shortened(text: str, limit: int) -> str:
    return text if len(text) <= limit else "…" + text[-(limit - 1) :]
