"""How many threads a kernel is worth.

Waking a second thread and waiting for it costs some 50 us on an idle machine and a whole time slice
(milliseconds) when another process holds its core; a kernel that takes less is faster alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache

import numba
from threadpoolctl import ThreadpoolController

PARALLEL_OBSERVATIONS = 200_000
"""Fewer observations are processed in one thread: a pass over them takes some milliseconds."""


@contextmanager
def threads_for(num_observations: int) -> Iterator[None]:
    """Run numba's parallel kernels in one thread when there is little to do.

    The kernels' results do not depend on the number of threads.
    """
    before = numba.get_num_threads()
    if num_observations < PARALLEL_OBSERVATIONS:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@cache
def _libraries() -> ThreadpoolController:
    """Looking for the loaded libraries takes milliseconds: once."""
    return ThreadpoolController()


def blas_threads(limit: int | None) -> AbstractContextManager[object]:
    """Linear algebra in at most so many threads: on small matrices they wait for one another.

    The last bits of a product depend on how many work on it: one thread gives the same everywhere.
    """
    return _libraries().limit(limits=limit, user_api="blas")


def one_thread() -> None:
    """Let this thread work alone from now on, whatever library it calls.

    For processes that there are as many of as threads are wanted. numba is told for the thread that
    calls; OpenCV and linear algebra know one number for the process, and are told once.
    """
    numba.set_num_threads(1)
    _one_thread_of_process()


@cache
def _one_thread_of_process() -> None:
    import cv2
    import scipy.linalg  # noqa: F401 - its BLAS is another than numpy's, and is to be loaded

    cv2.setNumThreads(1)
    ThreadpoolController().limit(limits=1, user_api="blas")
