"""So many wrong matches added that they are 10, 20, 30 % of all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.geometry.errors import errors, ratio, rms
from benchmarks.geometry.matches import join, simulate_matches, verify
from benchmarks.geometry.series import SERIES, SHARES, simulate, solve
from benchmarks.tables import table

NUM_ADDED = {60: 24, 7: 24, 5: 24}
"""Series a row where wrong matches are added."""
NOTE = (
    "All right matches of the clean series stay (images up to ten apart), and so many wrong "
    "ones come that they are the given share of all: half of them between any keypoints "
    "without a partner, half between such keypoints that lie within 2 px of each other's "
    "epipolar line and move like the right ones. Verification, track building and mapping are "
    "the program's. *Verified*: share of wrong ones among the verified matches; *left*: among "
    "the observations of the model. *To clean*: against the same series without wrong matches, "
    "± the standard error of the benchmark."
)
HEAD = [
    "frames / range",
    "wrong",
    "series",
    "verified",
    "left",
    "observations",
    "rotation deg",
    "to clean",
    "points",
    "to clean",
]


def make(data: Path, quick: bool) -> str:
    """The table: each series as it is, then with more and more wrong matches."""
    rows = []
    for series in SERIES[:3]:
        count = 4 if quick else NUM_ADDED[series.frames]
        clean: list[tuple[float, float]] = []
        for share in SHARES:
            figures, shares = [], []
            for seed in range(count):
                s = simulate(series, False, seed)
                put = simulate_matches(s, share, np.random.default_rng([seed, 1]))
                verified = verify(put, seed)
                fit = solve(replace(s, observations=join(put, verified)), False)
                shown, misplaced = put.shown(fit)
                true = np.where(shown[:, None] >= 0, s.points[shown], np.nan)
                figures.append(errors(fit, s, true))
                shares.append(
                    (
                        put.wrong_share(put.matches),
                        put.wrong_share(verified),
                        misplaced,
                        float(len(fit.observations)),
                    )
                )
            clean = clean or figures
            rotation, structure = rms(figures)
            to_clean = ratio(figures, clean)
            added, passed, left, kept = np.mean(shares, axis=0)
            rows.append(
                [
                    series.label,
                    f"{added:.1%}",
                    count,
                    f"{passed:.1%}",
                    f"{left:.2%}",
                    f"{kept:.0f}",
                    f"{rotation:.4f}",
                    to_clean[0],
                    f"{100 * structure:.4f} %",
                    to_clean[1],
                ]
            )
            print(rows[-1], flush=True)
    return f"{NOTE}\n\n{table(HEAD, rows)}"
