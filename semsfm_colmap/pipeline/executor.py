"""How the work on each image, pair or depth map is spread: here over threads of this process.

The compiled kernels and the libraries under them give up Python's lock, so threads are enough on
one machine; `dask_executor.py` is for several. Another engine is a class with what `Executor` asks
for. The functions that stages give to `map` can be pickled: they and their items hold arrays,
options and paths, no open file and no lock.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

from semsfm_colmap.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from semsfm_colmap.config import Config

A = TypeVar("A")
B = TypeVar("B")

LOOK_AHEAD = 2
"""Items begun before their turn, a worker: enough to keep all busy, few enough for the memory."""


class Executor(Protocol):
    """Applies a function to many items."""

    @property
    def num_workers(self) -> int:
        """How many items are worked on at a time."""
        ...

    @property
    def shares_memory(self) -> bool:
        """Whether a function may write into arrays of the caller: False in other processes."""
        ...

    def map(self, function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
        """Results in the order of the items, each as soon as it and those before it are there."""
        ...


@dataclass(frozen=True)
class ThreadExecutor:
    """So many threads of this process; -1 for one a core."""

    num_threads: int = -1

    @property
    def num_workers(self) -> int:
        """The number of threads."""
        return self.num_threads if self.num_threads > 0 else (os.cpu_count() or 1)

    @property
    def shares_memory(self) -> bool:
        """Threads do."""
        return True

    def map(self, function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
        """See `Executor`; what was not begun when the caller stops is never begun."""
        pending: deque[Future[B]] = deque()
        with ThreadPoolExecutor(self.num_workers) as pool:
            try:
                for item in items:
                    pending.append(pool.submit(function, item))
                    if len(pending) > LOOK_AHEAD * self.num_workers:
                        yield pending.popleft().result()
                while pending:
                    yield pending.popleft().result()
            finally:
                for future in pending:
                    future.cancel()


@contextmanager
def open_executor(
    config: Config, shared_path: Path | None = None, say: Callable[[str], None] = print
) -> Iterator[Executor]:
    """The executor that a configuration asks for; what it started ends with the block.

    Parameters
    ----------
    shared_path : a folder that workers on other machines must see
    say : told where the work goes, when that is not this process

    """
    if config.executor == "local":
        if config.scheduler_address is not None:
            raise UsageError("--scheduler_address is of --executor dask: give both")
        yield ThreadExecutor(config.num_threads)
        return
    from semsfm_colmap.io.extras import import_extra
    from semsfm_colmap.pipeline.dask_executor import DaskExecutor

    import_extra("distributed", "cluster")  # it takes a second, and said later is said too late
    with DaskExecutor(
        scheduler_address=config.scheduler_address,
        num_processes=ThreadExecutor(config.num_threads).num_workers,
        shared_path=shared_path,
        say=say,
    ) as executor:
        yield executor
