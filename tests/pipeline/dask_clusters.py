"""Dask clusters for the tests, and what stages have left, to be compared to the bit."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def scheduler_of_threads(num_workers: int = 2) -> Iterator[str]:
    """The address of a scheduler in this process, its workers threads: quick to start."""
    import cv2
    from distributed import LocalCluster
    from threadpoolctl import threadpool_limits

    num_cv2 = cv2.getNumThreads()
    with (
        threadpool_limits(None),  # workers change it for their process, which is ours here
        LocalCluster(
            n_workers=num_workers,
            threads_per_worker=1,
            processes=False,
            dashboard_address="127.0.0.1:0",
            memory_limit=None,
        ) as cluster,
    ):
        yield cluster.scheduler_address
    cv2.setNumThreads(num_cv2)


class OwnScheduler:
    """A scheduler and its workers as processes of their own, as on other machines."""

    def __init__(self, folder: Path, num_workers: int = 2) -> None:
        self.file = folder / "scheduler.json"
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        dask = [sys.executable, "-m", "dask"]
        place = ["--scheduler-file", str(self.file)]
        self.scheduler = subprocess.Popen(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *place],
            cwd=folder,
            **quiet,
        )
        self.workers = subprocess.Popen(
            [*dask, "worker", "--nworkers", str(num_workers), "--nthreads", "1", *place],
            cwd=folder,
            **quiet,
        )

    def address(self) -> str:
        """Where it listens, once it does."""
        import json
        import time

        for _ in range(600):
            if self.file.is_file() and self.file.stat().st_size:
                return str(json.loads(self.file.read_text())["address"])
            time.sleep(0.05)
        raise TimeoutError("the scheduler has not started")

    def kill_scheduler(self) -> None:
        """Nobody is told."""
        self.scheduler.kill()
        self.scheduler.wait()

    def __enter__(self) -> OwnScheduler:
        return self

    def __exit__(self, *error: object) -> None:
        for process in (self.workers, self.scheduler):
            process.terminate()
            process.wait(30)


class AfterFirst:
    """An executor that does something after the first result of each `map`."""

    shares_memory = False

    def __init__(self, inner: Any, act: Callable[[], None]) -> None:
        self.inner, self.act, self.num_times = inner, act, 0

    @property
    def num_workers(self) -> int:
        return int(self.inner.num_workers)

    def map(self, function: Callable[[Any], Any], items: Iterable[Any], /) -> Iterator[Any]:
        for number, result in enumerate(self.inner.map(function, items)):
            if number == 0:
                self.act()
                self.num_times += 1
            yield result


def kill_a_worker(executor: Any) -> None:
    """SIGKILL to one worker process of an executor."""
    pids = executor._client.run(os.getpid)
    os.kill(min(pids.values()), signal.SIGKILL)


def tables(database: Path) -> dict[str, list[tuple[Any, ...]]]:
    """All rows of all tables."""
    with closing(sqlite3.connect(database)) as connection:
        names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        return {
            name: connection.execute(f"SELECT * FROM {name} ORDER BY 1").fetchall()
            for (name,) in names.fetchall()
        }


def files(folder: Path) -> dict[str, bytes]:
    """The bytes of all files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
