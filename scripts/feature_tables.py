"""Gather the CSV files of the feature study into one page of tables.

    python scripts/feature_tables.py

Reads docs/features/<series>/*.csv, writes docs/features/tables.md.
"""

from __future__ import annotations

import csv
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs" / "features"


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def table(rows: list[list[str]]) -> list[str]:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|" + "---|" * len(rows[0]), *lines[1:], ""]


def pivot(rows: list[dict[str, str]], columns: tuple[str, ...], form: str) -> list[str]:
    """Detectors down, descriptors across, several columns in one cell."""
    detectors = list(dict.fromkeys(row["detector"] for row in rows))
    descriptors = list(dict.fromkeys(row["descriptor"] for row in rows))
    cells = {(row["detector"], row["descriptor"]): row for row in rows}
    body = []
    for detector in detectors:
        line = [detector]
        for descriptor in descriptors:
            row = cells[detector, descriptor]
            line.append(" / ".join(form.format(float(row[column])) for column in columns))
        body.append(line)
    return table([["", *descriptors], *body])


def series_section(folder: Path) -> list[str]:
    rows = read(folder / "figure12.csv")
    counts = ("matched", "heuristically_filtered", "robustly_filtered")
    lines = [f"## {folder.name}", ""]
    lines += ["Matches of consecutive images: matched / heuristically / robustly filtered.", ""]
    lines += pivot(rows, counts, "{:.0f}")
    if "precision_robust" in rows[0]:
        lines += [
            "True share of the verified matches (2 px), and median error of the true, px.",
            "",
        ]
        lines += pivot(rows, ("precision_robust", "error_px"), "{:.3f}")
        lines += ["Repeatability by viewing angle: share, median error in px.", ""]
        entries = read(folder / "repeatability.csv")
        angles = list(dict.fromkeys(entry["angle_deg"] for entry in entries))
        body = []
        for detector in dict.fromkeys(entry["detector"] for entry in entries):
            mine = {e["angle_deg"]: e for e in entries if e["detector"] == detector}
            keys = ("repeatability", "median_error_px")
            cells = [", ".join(f"{float(mine[a][key]):.2f}" for key in keys) for a in angles]
            body.append([detector, *cells])
        lines += table([["", *(f"{float(a):.0f} deg" for a in angles)], *body])
    shares = read(folder / "table1.csv")
    lines += ["Overlap of detectors, percent of all regions of both.", ""]
    lines += table(
        [
            ["", *list(shares[0])[1:]],
            *([r["percent"], *(f"{float(v):.0f}" for v in list(r.values())[1:])] for r in shares),
        ]
    )
    return lines


def main() -> None:
    lines = [
        "# Detectors and descriptors: all tables",
        "",
        "Made by `scripts/feature_study.py` and `scripts/feature_tables.py`; figures and CSV files"
        " lie in the folder of each series.",
        "",
    ]
    for folder in sorted(path for path in FOLDER.iterdir() if (path / "figure12.csv").is_file()):
        lines += series_section(folder)
    (FOLDER / "tables.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
