"""What `--quality` costs and gives: times and errors of each preset against the truth.

A SERIES is a folder with images/ and truth.json. Each quality is a run of `semsfm reconstruct` in a
process of its own, from the images to the report, and `semsfm evaluate` of what it left. What was
run before (`--output`) is not run again: give `--qualities` to run some of them now.

time: wall-clock seconds; CPU: seconds of all threads together, which another program on the machine
changes less. rotation: median error of the rotations. surface: median distance of the mesh from the
true surface; seen: share of the true surface within 2 px of the mesh.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks import tables
from semsfm_colmap.pipeline.evaluate import evaluate_project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.presets import PRESETS, QUALITIES
from semsfm_colmap.records import MapRecord

HEAD = ("series", "quality", "time s", "CPU s", "images", "points", "hand", "rotation deg",
        "sigma deg", "surface px", "seen %", "faces")  # fmt: skip


def cpu_seconds() -> float:
    """Of all processes started from here that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(series: Path, quality: str, project: Path) -> dict[str, Any]:
    """One row: reconstruct afresh and compare with the truth."""
    shutil.rmtree(project, ignore_errors=True)
    begin, used = time.perf_counter(), cpu_seconds()
    command = ["-m", "semsfm_colmap", "reconstruct", series / "images", "--output_path", project]
    subprocess.run([sys.executable, *map(str, command), "-q", "--quality", quality], check=True)
    seconds, cpu = time.perf_counter() - begin, cpu_seconds() - used
    figures, _ = evaluate_project(project, series)
    mapped = RunRecord.read(project / "run.json").result("map", MapRecord)
    assert mapped is not None
    return {
        "series": series.name,
        "quality": quality,
        "seconds": seconds,
        "cpu": cpu,
        "sigma": mapped.reliability.total_rotation_sigma_deg,
        "faces": json.loads((project / "report" / "metrics.json").read_text())["mesh"]["num_faces"],
        **figures,
    }


def row(data: dict[str, Any]) -> list[str]:
    """A run as cells."""
    hand = data["hand"] if data["depth_sign_status"] == "resolved" else "open"
    return [
        data["series"],
        data["quality"],
        f"{data['seconds']:.0f}",
        f"{data['cpu']:.0f}",
        f"{data['num_images_registered']} / {data['num_images_truth']}",
        str(data["num_points"]),
        hand,
        f"{data['rotation_error_median_deg']:.3f}",
        f"{data['sigma']:.3f}",
        f"{data['mesh_to_truth_abs_median_px']:.2f}",
        f"{data['truth_to_mesh_within_2px_percent']:.1f}",
        str(data["faces"]),
    ]


def options_table() -> str:
    """What each preset sets; high is the defaults."""
    from dataclasses import asdict

    from semsfm_colmap.config import preset

    configs = {quality: asdict(preset(quality)) for quality in QUALITIES}
    names = dict.fromkeys(
        (section, option)
        for options in PRESETS.values()
        for section, values in options.items()
        for option in values
    )
    rows = [
        [f"`{section}.{option}`", *(str(configs[q][section][option]) for q in QUALITIES)]
        for section, option in sorted(names)
    ]
    return tables.table(("option", *QUALITIES), rows)


def main() -> None:
    """Command line."""
    parser = tables.parser("quality", __doc__)
    parser.add_argument("series", nargs="+", type=Path, metavar="SERIES")
    parser.add_argument("--qualities", nargs="+", choices=QUALITIES, default=list(QUALITIES))
    parser.add_argument("--output", type=Path, default=Path("out/benchmark_quality"))
    tables.add_page_option(parser, "quality")
    arguments = parser.parse_args()
    rows = []
    for series in arguments.series:
        for quality in QUALITIES:
            project = arguments.output / f"{series.name}.{quality}"
            file = project.with_name(f"{project.name}.json")
            if not file.is_file():
                if quality not in arguments.qualities:
                    continue
                project.parent.mkdir(parents=True, exist_ok=True)
                data = run(series, quality, project)
                file.write_text(json.dumps(data, default=float), encoding="utf-8")
            rows.append(row(json.loads(file.read_text(encoding="utf-8"))))
            print(" ".join(rows[-1]), flush=True)
    text = f"{options_table()}\n\n{tables.table(HEAD, rows)}"
    print(text)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "quality", text)


if __name__ == "__main__":
    main()
