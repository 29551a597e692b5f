"""SIGKILL at random moments during `semsfm reconstruct`; the next run must end as if undisturbed.

usage: kill_test.py [--kills 50] [--seed 0] [--output FOLDER] [--images FOLDER] [-- OPTION ...]

Without --images a small series is rendered. One undisturbed run gives the model to compare with and
the time from which the moments are drawn. Then, for each moment: a run in a new project is killed,
run again, and must finish; the model's files must be the same to the bit, pycolmap must open the
database and find the same counts in it, and no half-written file may be left. OPTIONs go to
`semsfm reconstruct`, e.g. --database_path D.

Prints one line a kill and ends with exit code 1 when anything differed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

SMALL = SynthesizeOptions(
    scene="grain",
    num_images=5,
    step_deg=5.0,
    width_px=320,
    height_px=280,
    databar_rows=24,
    supersampling=1,
    mesh_edge_px=4.0,
    image_format="tif",
)
MODEL_FILES = (
    "cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin", "orthographic.json",
)  # fmt: skip


def start(images: Path, project: Path, options: list[str]) -> subprocess.Popen[bytes]:
    """A run in a process group of its own."""
    command = [sys.executable, "-m", "semsfm_colmap.cli.main", "reconstruct", str(images)]
    command += ["--output_path", str(project), "-q", *options]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )


def finish(images: Path, project: Path, options: list[str]) -> str:
    """Run to the end; the error output where it fails."""
    process = start(images, project, options)
    _, err = process.communicate(timeout=900)
    return "" if process.returncode == 0 else err.decode(errors="replace") or "failed"


def database_counts(project: Path) -> tuple[int, ...]:
    """What pycolmap finds in the database."""
    with pycolmap.Database.open(str(project / "database.db")) as db:
        return (
            db.num_images(),
            db.num_keypoints(),
            db.num_descriptors(),
            db.num_matches(),
            db.num_verified_image_pairs(),
            db.num_inlier_matches(),
        )


def differences(project: Path, reference: Path) -> list[str]:
    """What is not as in the undisturbed run."""
    found = []
    for name in MODEL_FILES:
        here, there = (p / "sparse" / "0" / name for p in (project, reference))
        if not here.is_file() or here.read_bytes() != there.read_bytes():
            found.append(f"sparse/0/{name} differs")
    try:
        if database_counts(project) != database_counts(reference):
            found.append("database.db has other counts")
    except RuntimeError as error:
        found.append(f"database.db does not open: {error}")
    left = [p.name for p in project.rglob(".*") if p.name.endswith((".part", ".old"))]
    return found + [f"{name} is left" for name in left]


def running_stage(project: Path) -> str:
    """The stage that run.json says is running."""
    try:
        stages = json.loads((project / "run.json").read_text())["stages"]
    except (OSError, ValueError):
        return "start"
    running = [name for name, stage in stages.items() if stage["status"] == "running"]
    return running[0] if running else f"after {list(stages)[-1]}" if stages else "start"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--images", type=Path)
    parser.add_argument("--output", type=Path)
    parser.add_argument("options", nargs="*")
    args = parser.parse_args()
    folder = args.output or Path(tempfile.mkdtemp(prefix="semsfm-kill-"))
    images = args.images or folder / "series" / "images"
    if not images.is_dir():
        synthesize(folder / "series", SMALL)
    reference = folder / "undisturbed"
    # twice: the first run also fills numba's cache
    for _ in range(2):
        shutil.rmtree(reference, ignore_errors=True)
        begin = time.monotonic()
        if error := finish(images, reference, args.options):
            print(f"the undisturbed run failed: {error}")
            return 1
        duration = time.monotonic() - begin
    print(f"undisturbed: {duration:.1f} s", flush=True)
    rng = np.random.default_rng(args.seed)
    failures, where = 0, Counter[str]()
    for k, moment in enumerate(rng.uniform(0.0, duration, args.kills)):
        project = folder / "killed"
        shutil.rmtree(project, ignore_errors=True)
        process = start(images, project, args.options)
        try:
            process.wait(timeout=moment)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        stage = running_stage(project) if process.returncode == -signal.SIGKILL else "finished"
        where[stage] += 1
        error = finish(images, project, args.options)
        found = [error] if error else differences(project, reference)
        failures += bool(found)
        print(f"{k + 1}: {moment:.2f} s, {stage}: {'; '.join(found) or 'same'}", flush=True)
        if found and args.output:
            shutil.copytree(project, folder / f"failed{k + 1}", dirs_exist_ok=True)
    print(f"{args.kills - failures} of {args.kills} ended with the same model; killed in {where}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
