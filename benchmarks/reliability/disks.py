"""Disks of many sizes, too small for a project: one sentence, and the rest where there is space.

As root the disks are file systems in memory; otherwise they are limits of the size of a file.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.reliability.projects import LOCK, Series, command, differences, fresh, run
from semsfm_colmap.io.atomic import UNFINISHED


def sizes_kb(number: int, least: float = 300.0, most: float = 20_000.0) -> list[int]:
    """Sizes of disks, in equal steps of their logarithm."""
    return [round(size) for size in np.geomspace(least, most, number)]


@contextmanager
def small_disk(folder: Path, size_kb: int) -> Iterator[tuple[Path, bool]]:
    """A folder on a disk of that size; False where only the size of a file is limited."""
    place = fresh(folder / "disk")
    place.mkdir()
    mounted = (
        os.getuid() == 0
        and not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "none", str(place)], check=False
        ).returncode
    )
    try:
        yield place, mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(place)], check=True)


def fill(series: Series, folder: Path, size_kb: int, *, limit: bool = False) -> dict[str, object]:
    """Run on a small disk, or below a limit of `ulimit -f`, then on where there is space."""
    with small_disk(folder, size_kb if not limit else 1 << 20) as (place, mounted):
        bound = size_kb << 10 if limit or not mounted else resource.RLIM_INFINITY
        done = subprocess.run(
            command(series, place / "p"),
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (bound, bound)),
        )
        said = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
        wrong = []
        if done.returncode != 0:
            named = len(said) == 1 and ("disk is full" in said[0] or "ulimit -f" in said[0])
            if done.returncode != 2 or not named:
                wrong.append(f"exit code {done.returncode}: {' / '.join(said)[:300]}")
            hidden = [p.name for p in place.rglob(".*") if p.name != LOCK]
            hidden = [name for name in hidden if not name.endswith(UNFINISHED)]  # gone on with
            wrong += [f"{name} is left" for name in hidden]
        project = fresh(folder / "spacious")
        if (place / "p").is_dir():
            shutil.copytree(place / "p", project)
    again = run(series, project)
    wrong += [again.stderr.strip()] if again.returncode else differences(project, series.reference)
    kind = "limit" if limit else "disk"
    return {"kind": kind, "size_kb": size_kb, "exit_code": done.returncode, "wrong": wrong}


def rows(results: list[dict[str, object]]) -> Iterator[tuple[object, ...]]:
    """Of the table: kind, sizes, too small, how many said so and ended the same."""
    for kind, words in (("disk", "disks"), ("limit", "limits of `ulimit -f`")):
        of = [r for r in results if r["kind"] == kind]
        if of:
            sizes = [int(str(r["size_kb"])) for r in of]
            small = sum(r["exit_code"] != 0 for r in of)
            right = sum(not r["wrong"] for r in of)
            yield words, f"{min(sizes)} to {max(sizes)} kB", len(of), small, right
