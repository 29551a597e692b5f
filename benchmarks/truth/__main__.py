"""Pulls of rendered series: total rotation, single rotations, points, distances between points.

Renders each series of a set into --folder, takes it through the map stage and compares it with its
exact truth. Renders, features and matches are kept, and what was measured: a second run goes on
where the first was stopped. --again maps and measures anew, for another version of the program.

Half a minute to two minutes a series on two cores.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from benchmarks.truth.pulls import coverage, measure, rms
from benchmarks.truth.series import TEST, TRAIN, Series
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.series import synthesize

QUANTITIES = ("rotation_pulls", "point_pulls", "distance_pulls")


def one(series: Series, folder: Path, *, again: bool, num_threads: int) -> dict[str, Any]:
    """Render, map and measure a series, or read what was measured before."""
    home = folder / series.name
    result = home / "pulls.json"
    if result.is_file() and not again:
        return dict(json.loads(result.read_text()))
    if not (home / "series" / "truth.json").is_file():
        synthesize(home / "series", series.options, lambda done, total: None)
    config = replace(Config(), num_threads=num_threads)
    try:
        record = run_stages(
            home / "project",
            config,
            names=("ingest", "extract", "match", "map"),
            image_path=home / "series" / "images",
        )
        found = measure(home / "project" / "sparse" / "0", home / "series")
        found["map_seconds"] = record.stages["map"].seconds
    except InputError as error:
        found = {"failure": str(error)}
    result.write_text(json.dumps(found))
    return found


def table(rows: Sequence[tuple[Series, dict[str, Any]]]) -> str:
    """One line a series, one line a row of series, one for all."""
    lines = [
        "| series | images | total deg | error deg | sigma deg | pull | median rotation deg "
        "| drag px | rotations | points | distances |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for series, found in rows:
        if "failure" in found:
            lines.append(f"| {series.name} | {found['failure']} |" + " |" * 9)
            continue
        drag = found["drag"]
        said = f"{drag['coefficient_px']:+.2f} +- {drag['sigma_px']:.2f}" if drag else "-"
        lines.append(
            f"| {series.name} | {found['num_images']}/{found['num_images_truth']} "
            f"| {found['total_deg']:.1f} | {found['total_error_deg']:+.3f} "
            f"| {found['total_sigma_deg']:.3f} | {found['total_pull']:+.2f} "
            f"| {found['rotation_error_median_deg']:.3f} | {said} | "
            + " | ".join(f"{rms(found[q]):.2f}" for q in QUANTITIES)
            + " |"
        )
    good = [(series, found) for series, found in rows if "failure" not in found]
    lines += [
        "",
        "RMS of the pulls (share within 1.96 sigma):",
        "",
        "| row | series | total rotation | rotations | points | distances |",
        "|---|---|---|---|---|---|",
    ]
    for row in [*dict.fromkeys(series.row for series, _ in good), "all"]:
        mine = [found for series, found in good if row in ("all", series.row)]
        totals = [found["total_pull"] for found in mine]
        cells = [f"{rms(totals):.2f} ({100 * coverage(totals):.0f} %)"]
        for quantity in QUANTITIES:
            # every series counts alike
            squares = [rms(found[quantity]) ** 2 for found in mine]
            shares = [coverage(found[quantity]) for found in mine]
            cells.append(f"{np.sqrt(np.mean(squares)):.2f} ({100 * np.mean(shares):.0f} %)")
        lines.append(f"| {row} | {len(mine)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run the command."""
    parser = tables.parser("truth", __doc__)
    tables.add_page_option(parser, "truth")
    parser.add_argument("--folder", type=Path, required=True, help="renders and runs are kept here")
    parser.add_argument("--set", choices=("train", "test"), default="test")
    parser.add_argument("--only", default="", help="series whose names hold this")
    parser.add_argument("--again", action="store_true", help="map and measure anew")
    parser.add_argument("--num_threads", type=int, default=-1)
    args = parser.parse_args()
    rows = []
    for series in TRAIN if args.set == "train" else TEST:
        if args.only not in series.name:
            continue
        rows.append((series, one(series, args.folder, again=args.again,
                                 num_threads=args.num_threads)))  # fmt: skip
        found = rows[-1][1]
        print(
            f"{series.name}: "
            + (found.get("failure") or f"pull {found['total_pull']:+.2f} of the total rotation"),
            flush=True,
        )
    print(table(rows))
    if args.markdown is not None:
        tables.put(args.markdown, "truth", table(rows))


if __name__ == "__main__":
    main()
