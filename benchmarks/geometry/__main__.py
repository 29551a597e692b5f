"""The geometry at its limit: every table of docs/benchmark_geometry.md.

optima      affine optima of published track sets from the one CBC start
efficiency  errors of simulated series against the Cramer-Rao bound, and normalised errors
colmap      the same simulated databases through pycolmap's expert set-up
outliers    10, 20, 30 % of the observations replaced by wrong ones
added       so many wrong matches added that they are 10, 20, 30 % of all
ceres       bundle adjustment against Ceres (pycolmap) on one model to the same cost
scale       up to 1000 frames and 8 million observations: seconds and peak memory
chain       fine steps and short tracks: in one piece and in segments

Times are of one run on a shared machine: compare rows of a table, never runs.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from benchmarks import tables

TITLES = {
    "optima": "Published affine optima",
    "efficiency": "Statistical efficiency",
    "colmap": "The same tracks through pycolmap's expert set-up",
    "outliers": "Wrong matches in the place of right ones",
    "added": "Wrong matches beside the right ones",
    "ceres": "Bundle adjustment against Ceres",
    "scale": "Size",
    "chain": "Fine steps, short tracks",
}
"""Of each table, which the module of the same name makes, in the order of the page."""


def command(name: str) -> str:
    """What makes one table alone."""
    return f"geometry --only {name}"


def main() -> None:
    """Command line."""
    parser = tables.parser("geometry", __doc__)
    parser.add_argument("--only", nargs="*", choices=list(TITLES), help="these tables alone")
    parser.add_argument(
        "--data", type=Path, default=Path("../shared/data"), help="folder with tracks/, for optima"
    )
    parser.add_argument("--quick", action="store_true", help="few series, the smallest sizes")
    tables.add_page_option(parser, *map(command, TITLES))
    args = parser.parse_args()
    for name in args.only or TITLES:
        make = importlib.import_module(f"benchmarks.geometry.{name}").make
        text = f"## {TITLES[name]}\n\n{make(args.data, args.quick)}\n"
        print(text, flush=True)
        if args.markdown:
            tables.put(args.markdown, command(name), text)


if __name__ == "__main__":
    main()
