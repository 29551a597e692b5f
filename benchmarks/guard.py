"""The cost of a small reconstruction against that of the last commit that was measured.

A grain is rendered and reconstructed, each stage in a process of its own, after a run that compiled
the kernels and does not count. Kept are processor seconds, which hardly depend on what else the
machine does, peak memory, how much work was done (keypoints, pairs, matches, observations, points,
faces) and how well (errors against the truth). Results stand in benchmarks/results/guard.json, an
entry a commit with the machine that it ran on; ``--save`` adds one. Nothing here ever fails: a
change of a tenth between commits is for a person to look at, between machines it means nothing.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import shutil
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks import tables
from benchmarks.profile import STAGES, measure
from semsfm_colmap.io.atomic import write_text

RESULTS = Path(__file__).parent / "results" / "guard.json"
LIBRARIES = ("numpy", "scipy", "numba", "pycolmap", "opencv-python-headless", "open3d-cpu")
HEAD = ("", "last", "now", "change")
NUM_IMAGES = 12


def render(folder: Path) -> None:
    """The series: half of the images of the example, at its angles."""
    from semsfm_colmap.synthetic.options import example_options
    from semsfm_colmap.synthetic.series import synthesize

    if not (folder / "truth.json").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        synthesize(folder, replace(example_options(), num_images=NUM_IMAGES))


def machine() -> str:
    """The processor, its cores, the system and Python."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        models = [s for s in info.read_text().splitlines() if s.startswith("model name")]
        name = models[0].split(":", 1)[1].strip() if models else name
    return (
        f"{name}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"
    )


def commit() -> str:
    """The commit that is checked out, with a plus where files differ from it."""
    root = Path(__file__).parent.parent

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return (git("rev-parse", "--short", "HEAD") or "unknown") + ("+" if changed else "")


def work_of(project: Path, truth: Path) -> dict[str, float]:
    """How much work was done, and how well."""
    from semsfm_colmap.colmap.database.work import read_images, read_keypoints, read_matches
    from semsfm_colmap.evaluation.compare import evaluate
    from semsfm_colmap.evaluation.truth import load_truth
    from semsfm_colmap.io.ply import read_ply_mesh
    from semsfm_colmap.pipeline.project import Project

    opened = Project(project)
    keypoints = read_keypoints(
        opened.database, [image.image_id for image in read_images(opened.database)]
    )
    matches = read_matches(opened.database)
    model = opened.read_main_model()
    figures = evaluate(model, load_truth(truth))
    mesh = read_ply_mesh(opened.mesh / "mesh.ply")
    return {
        "keypoints": sum(map(len, keypoints.values())),
        "pairs": len(matches),
        "matches": sum(map(len, matches.values())),
        "images": model.num_images,
        "observations": int(model.inlier.sum()),
        "points": len(model.points),
        "rotation error, deg": round(float(figures["rotation_error_median_deg"]), 4),
        "faces": len(mesh.faces),
    }


def run(folder: Path, *, compiled: bool = False) -> dict[str, Any]:
    """One entry of the results."""
    series = folder / "series"
    # apart: a process begins with the peak memory of the one that started it
    renderer = multiprocessing.get_context("spawn").Process(target=render, args=(series,))
    renderer.start()
    renderer.join()
    project = folder / "project"
    stages: dict[str, dict[str, float]] = {}
    for counts in (True,) if compiled else (False, True):
        shutil.rmtree(project, ignore_errors=True)
        for stage in STAGES:
            value = measure(project, stage, series / "images", profiled=False)
            if counts:
                stages[stage] = {
                    "CPU s": round(value.cpu_s, 2),
                    "peak MB": round(value.peak_mb),
                }
    return {
        "commit": commit(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": machine(),
        "versions": {name: version(name) for name in LIBRARIES},
        "stages": stages,
        "work": work_of(project, series),
    }


def load(path: Path) -> list[dict[str, Any]]:
    """The entries so far, oldest first."""
    entries: list[dict[str, Any]] = json.loads(path.read_text()) if path.is_file() else []
    return entries


def rows(last: dict[str, Any] | None, now: dict[str, Any]) -> list[list[str]]:
    """What changed: a row a figure."""
    before, after = figures_of(last or {}), figures_of(now)
    return [
        [
            name,
            f"{before[name]:g}" if name in before else "-",
            f"{value:g}",
            f"{100.0 * (value / before[name] - 1.0):+.0f} %" if before.get(name) else "-",
        ]
        for name, value in after.items()
    ]


def figures_of(entry: dict[str, Any]) -> dict[str, float]:
    """All figures of an entry by name."""
    stages = {
        f"{stage}, {name}": value
        for stage, values in entry.get("stages", {}).items()
        for name, value in values.items()
    }
    total = [values["CPU s"] for values in entry.get("stages", {}).values()]
    return {
        **stages,
        **({"all stages, CPU s": round(sum(total), 2)} if total else {}),
        **entry.get("work", {}),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.guard",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--output", type=Path, default=Path("out/benchmark_guard"))
    parser.add_argument(
        "--compiled", action="store_true", help="the kernels are compiled: no run before the one"
    )
    parser.add_argument("--save", action="store_true", help="add the entry to the results")
    arguments = parser.parse_args()
    entries = load(RESULTS)
    last = entries[-1] if entries else None
    now = run(arguments.output, compiled=arguments.compiled)
    if last is not None:
        print(f"last: {last['commit']} of {last['date']}, {last['machine']}")
    print(f"now:  {now['commit']} of {now['date']}, {now['machine']}")
    print(tables.table(HEAD, rows(last, now)))
    if arguments.save:
        RESULTS.parent.mkdir(exist_ok=True)
        write_text(json.dumps([*entries, now], indent=1) + "\n", RESULTS)


if __name__ == "__main__":
    main()
