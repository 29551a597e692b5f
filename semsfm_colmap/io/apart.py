"""A function called in another process, which may die of it: native code on files of others.

A decoder that trusts a damaged file reads and writes beyond its buffers, and the system ends the
process that it runs in. So it runs in a worker, which is told a function and its arguments through
a pipe and answers through another, file after file: starting it takes half a second, a question
less than a millisecond. Where it dies, or needs more processor time or memory than a good file
could, the caller is told why, and the next question goes to a new worker. Each thread that asks at
the same time has a worker of its own, up to one a core.

A worker is started as a program, not forked, and knows nothing of the script that runs. It ends
when its pipe is closed, as it is when this process ends, however that comes.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

from semsfm_colmap.errors import SemSfmError

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

P = ParamSpec("P")
T = TypeVar("T")

START = "import sys; sys.path[:] = sys.argv[1:]; from semsfm_colmap.io.apart import serve; serve()"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SECONDS_TO_END = 5.0
"""Between the last word of a worker and its end, on a busy machine"""
PIPE_BYTES = 1 << 20
"""What Linux lets a pipe hold; other systems take no notice."""


class DiedError(Exception):
    """The worker ended before it had an answer; the message says of what, in a few words."""


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """What one call may use before its worker is ended."""

    seconds: int
    """Of processor time"""
    num_bytes: int
    """Of address space, beyond what the worker has"""


ONE_FILE = Allowance(seconds=120, num_bytes=1 << 33)
"""For a file of which nothing is known before it is read"""


def call_apart(
    allowance: Allowance, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """What a function of a module returns or raises, called in another process.

    Parameters
    ----------
    function : can be pickled, as can its arguments, its result and what it raises; paths among them
        are absolute, as the worker stays in the folder where it was started

    Raises
    ------
    DiedError
        The process of the function died of it, a new one, too.

    """
    answer: T = POOL.ask(allowance, function, args, kwargs)
    return answer


class Worker:
    """A process that calls functions, one after the other."""

    def __init__(self) -> None:
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-c", START, *sys.path],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD},
                pipesize=PIPE_BYTES,
                start_new_session=True,  # Ctrl-C is for the process that asks
            )
        except OSError as error:
            raise SemSfmError(
                f"no process can be started to read files of others in ({error.strerror}): end "
                "some, or raise `ulimit -u`, and run the same command again"
            ) from error

        try:
            self._receive()  # that it is ready
        except DiedError as died:
            self.end()
            raise SemSfmError(
                f"the process that reads files of others does not start ({died}): run `semsfm "
                "doctor`"
            ) from died
        except BaseException:
            self.end()
            raise

    def ask(self, request: tuple[Any, ...]) -> tuple[bool, Any]:
        """Whether the call returned, and what it returned or raised."""
        assert self.process.stdin is not None
        question = pickle.dumps(request, protocol=5)
        with suppress(BrokenPipeError):  # then there is no answer
            self.process.stdin.write(question)
            self.process.stdin.flush()
        return self._receive()

    def _receive(self) -> tuple[bool, Any]:
        assert self.process.stdout is not None
        try:
            answer: tuple[bool, Any] = pickle.load(self.process.stdout)
        except Exception as error:  # half an answer may raise anything
            raise DiedError(self._cause()) from error
        return answer

    def _cause(self) -> str:
        try:
            code = self.process.wait(SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            return "half an answer"
        if code >= 0:  # on Windows always, which knows few of the signals
            return f"exit code {code}"
        if code == -signal.SIGXCPU:
            return "too much processor time"
        return signal.Signals(-code).name

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        with suppress(BrokenPipeError), self.process:
            pass


class Pool:
    """Workers that wait for a question."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew in a forked process: the workers are of the one that began them."""
        self.lock = threading.Lock()
        self.waiting: list[Worker] = []
        self.places = threading.BoundedSemaphore(os.cpu_count() or 1)

    def ask(
        self,
        allowance: Allowance,
        function: Callable[..., Any],
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
    ) -> Any:
        """See `call_apart`."""
        request = (allowance, function, args, kwargs)
        with self.places:
            worker = self._one_that_waits()
            if worker is not None:
                with suppress(DiedError):  # the file before may have harmed it
                    return self._ask(worker, request)
            return self._ask(Worker(), request)

    def _ask(self, worker: Worker, request: tuple[Any, ...]) -> Any:
        try:
            returned, answer = worker.ask(request)
        except BaseException:  # an answer that comes later would be taken for another
            worker.end()
            raise
        with self.lock:
            self.waiting.append(worker)
        if not returned:
            raise answer
        return answer

    def _one_that_waits(self) -> Worker | None:
        with self.lock:
            return self.waiting.pop() if self.waiting else None

    def close(self) -> None:
        """End the workers that wait."""
        with self.lock:
            while self.waiting:
                self.waiting.pop().end()


def serve() -> None:
    """What a worker does until its pipe is closed."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # where decoders may write
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    answer: tuple[bool, Any] = (True, None)
    while True:
        try:
            pickle.dump(answer, answers, protocol=5)
            answers.flush()
            request = pickle.load(sys.stdin.buffer)
        except (EOFError, BrokenPipeError):
            os._exit(0)  # nobody asks any more
        try:
            answer = (True, _called(*request))
        except Exception as error:
            answer = (False, error)


def _called(
    allowance: Allowance,
    function: Callable[..., Any],
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
) -> Any:
    _limit(allowance)
    return function(*args, **kwargs)


def _limit(allowance: Allowance) -> None:
    """Let the system end this process when a call uses more than it may, where a system does."""
    if resource is None:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime) + 1 + allowance.seconds
    _set_soft_limit(resource.RLIMIT_CPU, seconds)
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            num_pages = int(file.read().split()[0])
    except OSError:
        return  # no Linux
    _set_soft_limit(resource.RLIMIT_AS, num_pages * resource.getpagesize() + allowance.num_bytes)


def _set_soft_limit(kind: int, value: int) -> None:
    hard = resource.getrlimit(kind)[1]
    resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))


POOL = Pool()
atexit.register(POOL.close)
if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=POOL.forget)
