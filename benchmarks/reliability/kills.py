"""SIGKILL at random moments of a run: the next one ends as if there had been none."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.reliability.projects import (
    Series,
    command,
    differences,
    fresh,
    run,
    running_stage,
)


def moments(series: Series, folder: Path, number: int, seed: int) -> list[float]:
    """Moments from the start to the end of a run, as long as one takes now."""
    begin = time.monotonic()
    run(series, fresh(folder / "timed"))
    duration = time.monotonic() - begin
    # one in each of as many equal parts: no stage is passed over by chance
    rng = np.random.default_rng(seed)
    return [float(m) for m in duration * (np.arange(number) + rng.uniform(size=number)) / number]


def kill(series: Series, folder: Path, moment: float) -> dict[str, object]:
    """Kill one run and let the next one finish."""
    project = fresh(folder / "killed")
    process = subprocess.Popen(
        command(series, project),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(timeout=moment)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    stage = running_stage(project) if process.returncode == -signal.SIGKILL else "finished"
    done = run(series, project)
    wrong = [done.stderr.strip()] if done.returncode else differences(project, series.reference)
    return {"moment_s": round(moment, 2), "stage": stage, "wrong": wrong}


def rows(results: list[dict[str, object]]) -> Iterator[tuple[object, ...]]:
    """Of the table: stage, kills, how many ended the same."""
    for stage in dict.fromkeys(str(r["stage"]) for r in results):
        of = [r for r in results if r["stage"] == stage]
        yield stage, len(of), sum(not r["wrong"] for r in of)
    yield "all", len(results), sum(not r["wrong"] for r in results)
