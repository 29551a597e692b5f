"""Pulls of rendered series: total rotation, single rotations, points, distances between points.

Larger series are mapped twice, with the drag and the error bars in parts and without; --cases adds
what is said of inputs that were once answered wrongly.

Renders each series of a set into --folder, takes it through the map stage and compares it with its
exact truth. Renders, features and matches are kept, and what was measured: a second run goes on
where the first was stopped. --again maps and measures anew, for another version of the program.

Half a minute to two minutes a series on two cores.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from benchmarks.truth.before import before_and_after
from benchmarks.truth.cases import answers
from benchmarks.truth.measured import one
from benchmarks.truth.pulls import coverage, rms
from benchmarks.truth.series import LARGE, TEST, TRAIN, Series

QUANTITIES = ("rotation_pulls", "point_pulls", "distance_pulls")


def pulls_table(rows: Sequence[tuple[Series, dict[str, Any]]]) -> str:
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
    parser.add_argument("--set", choices=("large", "train", "test", "all"), default="all")
    parser.add_argument("--only", default="", help="series whose names hold this")
    parser.add_argument("--again", action="store_true", help="map and measure anew")
    parser.add_argument("--num_threads", type=int, default=-1)
    parser.add_argument("--series", type=Path, nargs="*", default=[], help="further large series")
    parser.add_argument("--cases", type=Path, help="folder of the cases")
    args = parser.parse_args()
    how = {"again": args.again, "num_threads": args.num_threads}
    parts = []
    if args.set in ("large", "all"):
        some = [series for series in LARGE if args.only in series.name]
        parts += [
            "### Larger series, without and with the drag and the error bars in parts",
            before_and_after(some, args.series, args.folder, **how),
        ]
    for name, members in (("test", TEST), ("train", TRAIN)):
        if args.set not in ((name, "all") if name == "test" else (name,)):
            continue
        rows = []
        for series in members:
            if args.only not in series.name:
                continue
            rows.append((series, one(series, args.folder, **how)))
            found = rows[-1][1]
            print(
                f"{series.name}: "
                + (
                    found.get("failure") or f"pull {found['total_pull']:+.2f} of the total rotation"
                ),
                flush=True,
            )
        parts += [f"### {len(rows)} series", pulls_table(rows)]
    if args.cases is not None:
        parts += [
            "### Cases that once were answered wrongly",
            answers(args.cases, args.folder, num_threads=args.num_threads),
        ]
    text = "\n\n".join(parts)
    print(text)
    if args.markdown is not None:
        tables.put(args.markdown, "truth", text)


if __name__ == "__main__":
    main()
