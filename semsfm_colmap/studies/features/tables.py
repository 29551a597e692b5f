"""The study as CSV files: one row a combination, a pair, a pair of detectors, an angle."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from semsfm_colmap.io.csv_cells import safe_rows
from semsfm_colmap.studies.features.result import StudyResult, mean_of, precision


def write_tables(result: StudyResult, folder: Path) -> list[Path]:
    """Write figure12.csv, figure13.csv, table1.csv, speed.csv, pairs.csv and repeatability.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [
        _write(folder / "figure12.csv", _figure12(result)),
        _write(folder / "figure13.csv", _figure13(result)),
        _write(folder / "table1.csv", _table1(result)),
        _write(
            folder / "speed.csv",
            [["detector", "features", "seconds", "us_per_feature"]]
            + [
                [
                    s.detector,
                    s.num_features,
                    f"{s.seconds:.3f}",
                    f"{s.microseconds_per_feature:.1f}",
                ]
                for s in result.speed
            ],
        ),
    ]
    if result.counts:
        header = list(asdict(result.counts[0]))
        rows = [[asdict(count)[key] for key in header] for count in result.counts]
        files.append(_write(folder / "pairs.csv", [header, *rows]))
    if result.has_truth:
        files.append(_write(folder / "repeatability.csv", _repeatability(result)))
    return files


def _figure12(result: StudyResult) -> list[Sequence[object]]:
    header = ["detector", "descriptor", "matched", "heuristically_filtered", "robustly_filtered"]
    truth = ["true_robust", "precision_matched", "precision_robust", "error_px"]
    rows: list[Sequence[object]] = [header + (truth if result.has_truth else [])]
    for detector in result.detectors:
        for descriptor in result.descriptors:
            counts = result.select_common(detector, descriptor)
            row: list[object] = [detector, descriptor]
            row += [f"{mean_of(counts, key):.1f}" for key in ("matched", "heuristic", "robust")]
            if result.has_truth:
                errors = [c.error_px for c in counts if np.isfinite(c.error_px)]
                row += [
                    f"{mean_of(counts, 'true_robust'):.1f}",
                    f"{precision(counts, 'matched'):.4f}",
                    f"{precision(counts, 'robust'):.4f}",
                    f"{np.mean(errors) if errors else np.nan:.3f}",
                ]
            rows.append(row)
    return rows


def _figure13(result: StudyResult) -> list[Sequence[object]]:
    rows: list[Sequence[object]] = [["image", *result.detectors]]
    columns = [result.select(detector, "sift") for detector in result.detectors]
    for k, name in enumerate(result.image_names[:-1]):
        rows.append([name, *(column[k].robust if column else "" for column in columns)])
    return rows


def _table1(result: StudyResult) -> list[Sequence[object]]:
    rows: list[Sequence[object]] = [["percent", *result.detectors]]
    for detector, shares in zip(result.detectors, result.overlap, strict=True):
        rows.append([detector, *(f"{100.0 * share:.1f}" for share in shares)])
    return rows


def _repeatability(result: StudyResult) -> list[Sequence[object]]:
    rows: list[Sequence[object]] = [
        ["detector", "angle_deg", "visible", "repeated", "repeatability", "median_error_px"]
    ]
    for detector, entries in result.repeatability.items():
        for r in entries:
            rows.append(
                [
                    detector,
                    f"{r.angle_deg:.2f}",
                    r.num_visible,
                    r.num_repeated,
                    f"{r.share:.4f}",
                    f"{r.error_px:.3f}",
                ]
            )
    return rows


def _write(path: Path, rows: Iterable[Sequence[object]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows(safe_rows(rows))
    return path
