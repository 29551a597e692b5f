"""Two threads of one process against two processes of dask, on this machine.

A reconstructed project is copied, and its keypoints, matches and depth maps with their fusion are
made anew, in turn by threads and by processes, so that both see the same other load; of several
runs the quickest of each stage counts. "start" is a cluster from nothing to its first answer, its
workers' imports included. All rows of the database and all files of dense/ are compared.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path

from benchmarks import tables
from semsfm_colmap.config import Config, config_from_dict
from semsfm_colmap.pipeline.dask_executor import DaskExecutor
from semsfm_colmap.pipeline.executor import Executor, ThreadExecutor
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import hash_file, hash_text
from semsfm_colmap.pipeline.runner import reconstruct, run_stages
from semsfm_colmap.synthetic.options import example_options
from semsfm_colmap.synthetic.series import synthesize

COMMAND = "executors"
NUM_WORKERS = 2
CONFIG = config_from_dict({"num_threads": NUM_WORKERS})
NAMES = ("extract", "match", "densify")
ENGINES = ("threads", "processes")
HEAD = ("", "start", *NAMES, "all but start", "all")


def introduce_libraries(number: int) -> int:
    """Work that is none, in a worker that has loaded what the stages need."""
    import semsfm_colmap.features.opencv_sift
    import semsfm_colmap.surface.fusion.fuse
    import semsfm_colmap.surface.stereo.depth_maps  # noqa: F401

    return number


def measure(source: Path, folder: Path, engine: str) -> dict[str, float]:
    """Seconds of each stage on a copy of a project, which is left in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(source, folder)
    seconds = {}
    with ExitStack() as stack:
        begin = time.perf_counter()
        executor: Executor = ThreadExecutor(NUM_WORKERS)
        if engine == "processes":
            executor = stack.enter_context(
                DaskExecutor(
                    scheduler_address=None,
                    num_processes=NUM_WORKERS,
                    shared_path=folder,
                    say=lambda line: None,
                )
            )
        list(executor.map(introduce_libraries, range(NUM_WORKERS)))
        seconds["start"] = time.perf_counter() - begin
        for name in NAMES:
            begin = time.perf_counter()
            run_stages(folder, CONFIG, names=(name,), executor=executor, force=True)
            seconds[name] = time.perf_counter() - begin
    return seconds


def results(project: Project) -> dict[str, str]:
    """Keys of all that the stages have left: files of dense/, tables of the database."""
    found = {
        path.relative_to(project.path).as_posix(): hash_file(path)
        for path in sorted(project.dense.rglob("*"))
        if path.is_file()
    }
    # by their rows: where in the file a row lies follows the order in which they were written
    with closing(sqlite3.connect(project.database)) as connection:
        names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        for (name,) in names:
            rows = connection.execute(f"SELECT * FROM {name} ORDER BY 1").fetchall()
            found[name] = hash_text(*map(repr, rows))
    return found


def row(label: str, seconds: dict[str, float]) -> tuple[str, ...]:
    """A line of the table."""
    stages = sum(seconds[name] for name in NAMES)
    columns = [seconds["start"], *(seconds[name] for name in NAMES)]
    return (label, *(f"{s:.1f}" for s in [*columns, stages, stages + seconds["start"]]))


def table_of(best: dict[str, dict[str, float]], num_files: int, num_same: int) -> str:
    """The table, and what it says of the results."""
    local, remote = (
        {**best[engine], "all": sum(best[engine][name] for name in NAMES)} for engine in ENGINES
    )
    ratios = [f"{remote[name] / max(local[name], 1e-9):.2f}" for name in (*NAMES, "all")]
    whole = (remote["all"] + remote["start"]) / (local["all"] + local["start"])
    return (
        tables.table(
            HEAD,
            [
                row(f"{NUM_WORKERS} threads", best["threads"]),
                row(f"{NUM_WORKERS} processes", best["processes"]),
                ("ratio", "", *ratios, f"{whole:.2f}"),
            ],
        )
        + "\n\nSeconds of wall-clock. "
        + f"{num_same} of {num_files} files and tables are the same to the bit."
    )


def main() -> None:
    """Measure, print, and put the table into a page."""
    parser = tables.parser(COMMAND, __doc__)
    parser.add_argument("--project", type=Path, help="a project; default: the example, made here")
    parser.add_argument("--repeat", type=int, default=3, help="runs of each (3)")
    tables.add_page_option(parser, COMMAND)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="semsfm-") as text:
        folder = Path(text)
        source = given.project
        if source is None:
            source = folder / "example"
            images = synthesize(folder / "series", example_options()).parent / "images"
            reconstruct(images, source, Config())
        runs: dict[str, list[dict[str, float]]] = {engine: [] for engine in ENGINES}
        for number in range(given.repeat):
            for engine in ENGINES:
                seconds = measure(source, folder / engine, engine)
                runs[engine].append(seconds)
                print(number + 1, engine, *(f"{k} {v:.1f} s" for k, v in seconds.items()))
        best = {
            engine: {name: min(run[name] for run in some) for name in some[0]}
            for engine, some in runs.items()
        }
        here, there = (results(Project(folder / engine)) for engine in ENGINES)
        same = sum(there.get(name) == key for name, key in here.items())
        said = table_of(best, len(here | there), same)
    print(said)
    if given.markdown is not None:
        tables.put(given.markdown, COMMAND, said)


if __name__ == "__main__":
    main()
