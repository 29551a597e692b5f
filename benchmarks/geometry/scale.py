"""Up to 1000 frames and 8 million observations: seconds and peak memory."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.geometry.errors import errors
from benchmarks.geometry.long_series import long_series
from benchmarks.geometry.series import SERIES, simulate, solve
from benchmarks.tables import table
from semsfm_colmap.factorization.factorize import factorize_most, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.band import BandFactor, BandMatrix
from semsfm_colmap.refinement.covariance import estimate_covariance
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.tracks.split import split_tracks

HEAD = [
    "frames",
    "tracks",
    "observations",
    "blocks",
    "factorization",
    "refinement",
    "covariance",
    "of both the reduced system s",
    "total s",
    "CPU s",
    "peak GB",
    "of it input GB",
    "rotation RMS deg",
]


def make(data: Path, quick: bool) -> str:
    """The table, each size in a process of its own."""
    sizes = [(n, 1000 * n) for n in (100, 300, 600, 1000)]
    rows = []
    for frames, tracks in sizes[:1] if quick else sizes:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.geometry.scale", str(frames), str(tracks)],
            cwd=Path(__file__).parents[2],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        line = next(x for x in done.stdout.splitlines() if x.startswith("ROW|"))
        rows.append(line.split("|")[1:])
        print(rows[-1], flush=True)
    return table(HEAD, rows)


def run_scale(frames: int, tracks: int) -> None:
    """One size in a process of its own, so that the peak memory is its own."""
    solve(simulate(SERIES[1], False, 0), False)  # compile
    s = long_series(frames, tracks, 8)
    obs, base = s.observations, peak_gb()
    rng = np.random.default_rng(0)
    times, memory, reduced = [], [], []
    spent = watch_reduced_system()
    begin, begin_cpu = time.monotonic(), time.process_time()

    def lap() -> None:
        nonlocal begin
        times.append(time.monotonic() - begin)
        memory.append(peak_gb())
        reduced.append(sum(spent))
        spent.clear()
        begin = time.monotonic()

    options = FactorizationOptions()
    part = find_parts(obs, options)[0]
    lap()
    tied, start = factorize_most(part, obs, options, rng)
    assert start.value is not None, start.message
    lap()
    chosen = RefinementOptions()
    seen = split_tracks(
        obs,
        start.value.cameras,
        tied.images,
        min_length=chosen.min_track_length,
        trials=chosen.ransac_trials,
    )
    fit = refine(start.value.cameras, tied.images, seen, chosen, rng=rng)
    assert fit.value is not None
    lap()
    v = fit.value
    end = v.adjustment
    estimate_covariance(end.model, end.state, v.observations, v.sigma_px)
    lap()
    rotation, _ = errors(v, s)
    cells = [
        frames,
        f"{tracks:,}",
        f"{len(obs):,}",
        *[f"{t:.1f} s, {m:.1f} GB" for t, m in zip(times, memory, strict=True)],
        f"{sum(reduced[2:]):.2f}",
        f"{sum(times):.0f}",
        f"{time.process_time() - begin_cpu:.0f}",
        f"{max(memory):.1f}",
        f"{base:.1f}",
        f"{rotation:.4f}",
    ]
    print("ROW|" + "|".join(str(c) for c in cells), flush=True)


def peak_gb() -> float:
    """The most memory that this process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def watch_reduced_system() -> list[float]:
    """Seconds of every call that sets up, factorises, solves or inverts a reduced system."""
    spent: list[float] = []

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            begin = time.monotonic()
            try:
                return function(*args, **kwargs)
            finally:
                spent.append(time.monotonic() - begin)

        return call

    for owner, name in (
        (BandMatrix, "add_blocks"),
        (BandMatrix, "get_blocks"),
        (BandMatrix, "factorise"),
        (BandFactor, "solve"),
        (BandFactor, "inverse"),
    ):
        setattr(owner, name, watched(getattr(owner, name)))
    return spent


if __name__ == "__main__":
    run_scale(*map(int, sys.argv[1:]))
