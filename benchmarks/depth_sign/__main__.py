"""How often is the hand right, and is the confidence honest? The source of the cues' weights.

Draws --scenes training scenes and as many test scenes of closed bodies, fields and bodies on a
substrate, turned by 10 to 360 degrees in 3 to 72 images (semsfm_colmap.synthetic.occluded_tracks),
with errors of cameras, points and matches at realistic levels, and models fitted to noise. On the
training scenes the factors between t statistics and log odds are fitted (printed beside the ones in
use, which are constants of semsfm_colmap.refinement.depth_reversal.visibility); the tables are of
the test scenes with the ones in use. --end-to-end takes tracks through factorization and
refinement. --renders adds forty rendered series with strong shading, charging, blur and without
background, taken from their images to the hand. --project adds mapped projects, with their truth
where there is one.

About half a second a scene. --rows keeps what was measured; a second run then only fits and prints.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

from benchmarks import tables
from benchmarks.depth_sign.calibration import by_kind, fit, reliability
from benchmarks.depth_sign.projects import project_row
from benchmarks.depth_sign.rendered import rendered
from benchmarks.depth_sign.scenes import (
    HOLLOW,
    SIGMA_TILT_DEG,
    TEST,
    TRAIN,
    Row,
    simulate,
    simulate_noise,
    through_the_pipeline,
)
from semsfm_colmap.refinement.depth_reversal import visibility as in_use


def collect(args: argparse.Namespace) -> dict[str, list[Row]]:
    """Measure the scenes, or read those that were measured before."""
    path = Path(args.rows) if args.rows else None
    stored = json.loads(path.read_text()) if path and path.is_file() else {}
    groups: dict[str, tuple[int, Callable[[int], Row]]] = {
        "train": (args.scenes, lambda k: simulate(TRAIN, k)),
        "test": (args.scenes, lambda k: simulate(TEST, k)),
        "hollow": (args.scenes // 8, lambda k: simulate(HOLLOW, k, "cup")),
        "noise": (args.scenes // 3, simulate_noise),
        "through": (args.end_to_end, through_the_pipeline),
    }
    rows: dict[str, list[Row]] = {}
    for name, (count, one) in groups.items():
        rows[name] = [Row(**row) for row in stored.get(name, [])][:count]
        for k in range(len(rows[name]), count):
            rows[name].append(one(k))
            if (k + 1) % 50 == 0 or name == "through":
                print(f"{name}: {k + 1} of {count}", flush=True)
        if path:  # group by group, so that a run that is stopped keeps what it has
            done = {n: [asdict(r) for r in some] for n, some in rows.items()}
            path.write_text(json.dumps(stored | done))
    return rows


def report(rows: dict[str, list[Row]], projects: Iterable[str], renders: Path | None) -> str:
    """The tables, in Markdown."""
    fitted = fit(rows["train"])
    test, hollow, noise, through = (rows[k] for k in ("test", "hollow", "noise", "through"))
    factors = [[n, f"{fitted[n]:.2f}", f"{used:.2f}"] for n, (used, _) in in_use.CUES.items()]
    parts = [
        "### Factors from t to log odds",
        tables.table(["cue", "fitted on the training scenes", "in use"], factors),
        f"### Reliability, {len(test)} test scenes, visibility alone",
        reliability(test, False),
        "### Reliability, the same with a known tilt (turns below 150°, read to "
        f"{SIGMA_TILT_DEG}°)",
        reliability(test, True),
        "### What becomes of each kind, visibility alone",
        by_kind(test, False),
        "### What becomes of each kind, with a known tilt",
        by_kind(test, True),
        f"### {len(hollow)} more hollow bodies, visibility alone",
        by_kind(hollow, False),
        reliability(hollow, False),
        f"### {len(noise)} models fitted to noise",
        by_kind(noise, False),
        "With a tilt that has nothing to do with them:",
        by_kind(noise, True),
    ]
    if through:
        mapped = [r for r in through if r.logit]
        parts += [
            f"### {len(mapped)} of {len(through)} sets of tracks taken through factorization and "
            "refinement",
            by_kind(mapped, False),
            reliability(mapped, False),
        ]
    if renders is not None:
        parts += ["### Rendered series, from images to the hand", rendered(renders)]
    series = [project_row(text) for text in projects]
    if series:
        head = ["series", "images", "points", *in_use.CUES, "status", "confidence", "hand"]
        parts += [
            "### Series",
            "t statistics, positive for the hand that was chosen.",
            tables.table(head, series),
        ]
    return "\n\n".join(parts)


def main() -> None:
    """Command line."""
    parser = tables.parser("depth_sign", __doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--end-to-end", type=int, default=20)
    parser.add_argument("--rows", help="where to keep the measurements")
    parser.add_argument("--renders", type=Path, help="renders and maps hard series below it")
    parser.add_argument("--project", nargs="*", default=[], help="FOLDER[:TRUTH]")
    tables.add_page_option(parser, "depth_sign")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    text = report(collect(args), args.project, args.renders)
    print(text)
    if args.markdown:
        tables.put(args.markdown, "depth_sign", text)


if __name__ == "__main__":
    main()
