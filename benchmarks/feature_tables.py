"""Gather the CSV files of the feature study into one page of tables.

Reads <series>/*.csv of a folder, which benchmarks.feature_study wrote, and puts the tables into its
tables.md.
"""

from __future__ import annotations

import csv
from pathlib import Path

from benchmarks import tables


def read(path: Path) -> list[dict[str, str]]:
    """The lines of a CSV file by the names of its columns."""
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def pivot(rows: list[dict[str, str]], columns: tuple[str, ...], form: str) -> str:
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
    return tables.table(["", *descriptors], body)


def repeatability(entries: list[dict[str, str]]) -> str:
    """Detectors down, viewing angles across: share and median error in one cell."""
    angles = list(dict.fromkeys(entry["angle_deg"] for entry in entries))
    body = []
    for detector in dict.fromkeys(entry["detector"] for entry in entries):
        mine = {e["angle_deg"]: e for e in entries if e["detector"] == detector}
        keys = ("repeatability", "median_error_px")
        cells = [", ".join(f"{float(mine[a][key]):.2f}" for key in keys) for a in angles]
        body.append([detector, *cells])
    return tables.table(["", *(f"{float(a):.0f} deg" for a in angles)], body)


def series_section(folder: Path) -> list[str]:
    """The paragraphs and tables of a series."""
    rows = read(folder / "figure12.csv")
    counts = ("matched", "heuristically_filtered", "robustly_filtered")
    parts = [
        f"## {folder.name}",
        "Matches of consecutive images: matched / heuristically / robustly filtered.",
        pivot(rows, counts, "{:.0f}"),
    ]
    if "precision_robust" in rows[0]:
        parts += [
            "True share of the verified matches (2 px), and median error of the true, px.",
            pivot(rows, ("precision_robust", "error_px"), "{:.3f}"),
            "Repeatability by viewing angle: share, median error in px.",
            repeatability(read(folder / "repeatability.csv")),
        ]
    shares = read(folder / "table1.csv")
    overlap = [[r["percent"], *(f"{float(v):.0f}" for v in list(r.values())[1:])] for r in shares]
    parts += [
        "Overlap of detectors, percent of all regions of both.",
        tables.table(["", *list(shares[0])[1:]], overlap),
    ]
    return parts


def main() -> None:
    """Command line."""
    parser = tables.parser("feature_tables", __doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs/features"))
    folder = parser.parse_args().folder
    series = sorted(path for path in folder.iterdir() if (path / "figure12.csv").is_file())
    parts = [part for path in series for part in series_section(path)]
    tables.put(folder / "tables.md", "feature_tables", "\n\n".join(parts))


if __name__ == "__main__":
    main()
