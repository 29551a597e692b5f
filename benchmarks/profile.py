"""Where the time goes: processor time, wall-clock time and memory of each stage, and its functions.

A SERIES is a folder with images/, or of images. Every stage runs in a process of its own, so that
its peak memory is its own; a run of the first series that does not count has compiled the kernels
before. CPU seconds are those of all threads of the process, and hardly depend on what else the
machine does; wall-clock seconds do. Per megapixel: of all prepared images together.

The second table has the functions in which the stages spend at least SHARE of their CPU seconds,
without the functions that these call in turn; a second run under Python's profiler gives them.
"""

from __future__ import annotations

import argparse
import cProfile
import multiprocessing
import pstats
import resource
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import tables

STAGES = ("ingest", "extract", "match", "map", "densify", "mesh")
SHARE = 0.08
MAX_NAME = 60
HEAD = (
    "series",
    "stage",
    "wall s",
    "CPU s",
    "CPU ms a frame",
    "CPU ms a megapixel",
    "peak MB",
)
FUNCTION_HEAD = ("series", "stage", "function", "calls", "CPU s", "share")
MB = 1 << 20


@dataclass(frozen=True)
class Measured:
    """One run of a stage."""

    wall_s: float
    cpu_s: float
    peak_mb: float
    functions: tuple[tuple[str, int, float], ...]
    """name, calls and CPU seconds of each, empty without the profiler"""


def cpu_seconds() -> float:
    """User and system time of all threads of this process."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def peak_mb() -> float:
    """Largest resident memory so far; the kernel counts in kB, macOS in bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MB


def run_stage(pipe: Any, project: Path, stage: str, images: Path, profiled: bool) -> None:
    """Run a stage in this process, and send what it took; loading the package counts."""
    wall, cpu = time.perf_counter(), cpu_seconds()
    from semsfm_colmap.config import Config
    from semsfm_colmap.pipeline.runner import run_stages

    profiler = cProfile.Profile(time.process_time)
    if profiled:
        profiler.enable()
    run_stages(project, Config(), names=(stage,), image_path=images, force=True)
    profiler.disable()
    wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
    functions = functions_of(profiler) if profiled else ()
    pipe.send(Measured(wall_s=wall, cpu_s=cpu, peak_mb=peak_mb(), functions=functions))


def functions_of(profiler: cProfile.Profile) -> tuple[tuple[str, int, float], ...]:
    """Functions by the time that they themselves take, the longest first."""
    profiler.create_stats()
    rows = []
    stats: dict[tuple[str, int, str], Any] = pstats.Stats(profiler).stats  # type: ignore[attr-defined]
    for (path, _, name), (_, calls, own, _, _) in stats.items():
        rows.append((f"{Path(path).stem}.{name}" if path != "~" else name, int(calls), float(own)))
    return tuple(sorted(rows, key=lambda row: -row[2]))


def measure(project: Path, stage: str, images: Path, *, profiled: bool) -> Measured:
    """Run a stage in a process of its own."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=run_stage, args=(sender, project, stage, images, profiled))
    process.start()
    sender.close()
    try:
        value: Measured = receiver.recv()
    except EOFError:
        raise SystemExit(f"stage {stage} of {project} failed") from None
    finally:
        process.join()
    return value


def stage_row(
    series: str, stage: str, value: Measured, frames: int, megapixels: float
) -> list[str]:
    """A row of the first table."""
    return [
        series,
        stage,
        f"{value.wall_s:.1f}",
        f"{value.cpu_s:.1f}",
        f"{1e3 * value.cpu_s / frames:.0f}",
        f"{1e3 * value.cpu_s / megapixels:.0f}",
        f"{value.peak_mb:.0f}",
    ]


def function_rows(series: str, stage: str, value: Measured) -> list[list[str]]:
    """Rows of the second table: what takes SHARE of a stage or more."""
    total = sum(own for _, _, own in value.functions)
    return [
        [
            series,
            stage,
            f"`{name[:MAX_NAME]}`",
            str(calls),
            f"{own:.1f}",
            f"{100 * own / total:.0f} %",
        ]
        for name, calls, own in value.functions
        if own >= SHARE * total
    ]


def frame_sizes(project: Path) -> tuple[int, float]:
    """Number of prepared images, and their megapixels together."""
    from semsfm_colmap.pipeline.project import Project

    frames = Project(project).read_series().frames
    return len(frames), sum(f.width_px * f.height_px for f in frames) / 1e6


def main() -> None:
    """Command line."""
    parser = tables.parser("profile", __doc__)
    parser.add_argument("series", nargs="+", type=Path, metavar="SERIES")
    parser.add_argument("--output", type=Path, default=Path("out/benchmark_profile"))
    parser.add_argument("--to", choices=STAGES, default="map", help="the last stage")
    tables.add_page_option(parser, "profile")
    text = run(parser.parse_args())
    print(text)


def run(arguments: argparse.Namespace) -> str:
    """Both tables, put into the page that was asked for."""
    stages = STAGES[: STAGES.index(arguments.to) + 1]
    rows: list[list[str]] = []
    functions: list[list[str]] = []
    for k, series in enumerate([arguments.series[0], *arguments.series]):
        images = series / "images" if (series / "images").is_dir() else series
        project = arguments.output / series.name
        shutil.rmtree(project, ignore_errors=True)
        for stage in stages:
            value = measure(project, stage, images, profiled=False)
            if k == 0:
                continue
            rows.append(stage_row(series.name, stage, value, *frame_sizes(project)))
            print(" ".join(rows[-1]), flush=True)
            again = measure(project, stage, images, profiled=True)
            functions += function_rows(series.name, stage, again)
    text = f"{tables.table(HEAD, rows)}\n\n{tables.table(FUNCTION_HEAD, functions)}"
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "profile", text)
    return text


if __name__ == "__main__":
    main()
