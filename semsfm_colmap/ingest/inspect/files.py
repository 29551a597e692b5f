"""An inspection as JSON and CSV files."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, fields
from pathlib import Path

from semsfm_colmap.ingest.inspect.inspection import Inspection
from semsfm_colmap.ingest.inspect.rows import InspectionRow
from semsfm_colmap.io.atomic import write_text
from semsfm_colmap.io.csv_cells import safe_row

ONLY_IN_TEXT = ("displacement_um", "kept", "num_pages")
FILE_FIELDS = tuple(f.name for f in fields(InspectionRow) if f.name not in ONLY_IN_TEXT)
"""Fields of the JSON and CSV files."""


def write_inspection_json(inspection: Inspection, path: Path) -> None:
    """One object per image, with null where nothing is recorded."""
    rows = [{name: getattr(row, name) for name in FILE_FIELDS} for row in inspection.rows]
    text = json.dumps(rows, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(text + "\n", path, shared=True)


def write_inspection_csv(inspection: Inspection, path: Path) -> None:
    """One line per image with the fields as columns; empty cells where nothing is recorded."""
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer)
    writer.writerow(FILE_FIELDS)
    for row in inspection.rows:
        values = asdict(row)
        values["warnings"] = "; ".join(row.warnings)
        cells = ["" if values[name] is None else values[name] for name in FILE_FIELDS]
        writer.writerow(safe_row(cells))
    write_text(buffer.getvalue(), path, shared=True)
