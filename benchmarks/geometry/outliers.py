"""10, 20, 30 % of the observations replaced by wrong ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.geometry.errors import bounds, errors, only_right, ratio, rms
from benchmarks.geometry.series import SERIES, SHARES, simulate, solve
from benchmarks.tables import table

NUM_REPLACED = {60: 40, 7: 60, 5: 60}
"""Series a row where observations are replaced by wrong ones."""
NOTE = (
    "A wrong observation stands in the place of a right one, so wrong ones both mislead and "
    "are missing. *To the oracle*: against the same right observations alone, what the wrong "
    "ones spoil. *To clean*: against the same series before any was replaced. *Bound*: what is "
    "missing alone, the Cramer-Rao bound of the right observations that are left (of tracks "
    "that keep three) over that of all: no method comes below. ± is the standard error of the "
    "benchmark."
)
HEAD = [
    "frames / range",
    "wrong",
    "series",
    "rotation deg",
    "to the oracle",
    "to clean",
    "bound",
    "points",
    "to the oracle",
    "to clean",
    "bound",
]


def make(data: Path, quick: bool) -> str:
    """The table: each series as it is, then with more and more of it replaced."""
    rows = []
    for series in SERIES[:3]:
        count = 4 if quick else NUM_REPLACED[series.frames]
        clean: list[tuple[float, float]] = []
        clean_bound: list[tuple[float, float]] = []
        for share in SHARES:
            figures, oracle, bound = [], [], []
            for seed in range(count):
                s = simulate(series, False, seed, outlier_share=share)
                figures.append(errors(solve(s, False), s))
                oracle.append(errors(solve(only_right(s), False), s))
                bound.append(bounds(s, np.random.default_rng(seed)))
            clean, clean_bound = clean or figures, clean_bound or bound
            rotation, structure = rms(figures)
            to_oracle, to_clean = ratio(figures, oracle), ratio(figures, clean)
            least = rms(bound) / rms(clean_bound)
            rows.append(
                [
                    series.label,
                    f"{share:.0%}",
                    count,
                    f"{rotation:.4f}",
                    to_oracle[0],
                    to_clean[0],
                    f"{least[0]:.2f}",
                    f"{100 * structure:.4f} %",
                    to_oracle[1],
                    to_clean[1],
                    f"{least[1]:.2f}",
                ]
            )
            print(rows[-1], flush=True)
    return f"{NOTE}\n\n{table(HEAD, rows)}"
