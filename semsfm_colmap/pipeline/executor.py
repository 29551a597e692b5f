"""How the work on each image, pair or depth map is spread: here over threads of this process.

The compiled kernels and the libraries under them give up Python's lock, so threads are enough on
one machine. Another engine is a class with the same `map` and `num_workers`.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar

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
