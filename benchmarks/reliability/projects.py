"""A small series, the project that an undisturbed run makes of it, and how another differs."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.colmap.database.content import PARTS, content_key
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

SMALL = SynthesizeOptions(
    scene="grain",
    num_images=5,
    step_deg=5.0,
    width_px=200,
    height_px=180,
    databar_rows=20,
    supersampling=1,
    mesh_edge_px=4.0,
    image_format="tif",
)
OF_THE_RUN = {"run.json", "semsfm.log", "report/report.html", "report/metrics.json"}
"""They hold times."""
FIGURES = "report/figures/"
LOCK = ".semsfm.lock"
SECONDS = 900


@dataclass(frozen=True, kw_only=True)
class Series:
    """Images, what becomes of them undisturbed, and options that go with it."""

    images: Path
    reference: Path
    options: tuple[str, ...] = ()


def make_series(folder: Path, images: Path | None = None, options: tuple[str, ...] = ()) -> Series:
    """The series in a folder, made where it is not there yet."""
    if images is None:
        images = folder / "series" / "images"
        if not images.is_dir():
            synthesize(folder / "series", SMALL)
    series = Series(images=images, reference=folder / "undisturbed", options=options)
    if not (series.reference / "report" / "report.html").is_file():
        done = run(series, series.reference)
        if done.returncode != 0:
            raise SystemExit(f"the undisturbed run failed: {done.stderr}")
    return series


def command(series: Series, project: Path) -> list[str]:
    """Of the whole reconstruction."""
    start = [sys.executable, "-m", "semsfm_colmap.cli.main", "reconstruct", str(series.images)]
    return [*start, "--output_path", str(project), "-q", *series.options]


def run(series: Series, project: Path) -> subprocess.CompletedProcess[str]:
    """Run it to its end."""
    return subprocess.run(
        command(series, project), capture_output=True, text=True, timeout=SECONDS, check=False
    )


def files(project: Path) -> set[str]:
    """Names of all files."""
    return {p.relative_to(project).as_posix() for p in project.rglob("*") if p.is_file()}


def differences(project: Path, reference: Path) -> list[str]:
    """What is not as in the undisturbed run: files, rows of the database, leftovers."""
    here, there = files(project), files(reference)
    found = [f"{name} is missing" for name in sorted(there - here)]
    found += [f"{name} is left" for name in sorted(here - there) if not name.startswith("changed/")]
    for name in sorted(here & there - OF_THE_RUN):
        if name == "database.db":
            keys = [[content_key(p / name, part) for part in PARTS] for p in (project, reference)]
            same = keys[0] == keys[1] and None not in keys[0]
        else:
            # a figure shows times of stages, or is drawn beside one that does
            same = name.startswith(FIGURES) or (
                (project / name).read_bytes() == (reference / name).read_bytes()
            )
        if not same:
            found.append(f"{name} differs")
    return found


def running_stage(project: Path) -> str:
    """The stage that run.json says is running."""
    try:
        stages = json.loads((project / "run.json").read_text())["stages"]
    except (OSError, ValueError):
        return "ingest"
    running = [name for name, stage in stages.items() if stage["status"] == "running"]
    return running[0] if running else f"after {list(stages)[-1]}" if stages else "ingest"


def fresh(path: Path, source: Path | None = None) -> Path:
    """A path with nothing there, or with a copy."""
    shutil.rmtree(path, ignore_errors=True)
    if source is not None:
        shutil.copytree(source, path)
    return path
