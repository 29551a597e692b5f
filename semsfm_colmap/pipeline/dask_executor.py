"""The work on images, pairs and depth maps over processes of this machine or of others, by dask.

A function is pickled and sent once; each worker unpickles it for itself and keeps what it reads,
such as images, for as long as the function is in use. Items follow one by one, few ahead of their
turn, and results come back in the order of the items: what they are does not depend on who worked
on which. Only this process writes into the project.

A worker that dies costs the items it had: dask gives them to others. An item at which several die
in turn, and a scheduler that is gone, are a `ClusterError`; what was written by then is kept.
"""

from __future__ import annotations

import logging
import pickle
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from semsfm_colmap.errors import ClusterError, UsageError
from semsfm_colmap.io.extras import import_extra
from semsfm_colmap.pipeline.executor import LOOK_AHEAD
from semsfm_colmap.version import __version__

if TYPE_CHECKING:
    from distributed import Client, Future

A = TypeVar("A")
B = TypeVar("B")

CONNECT_S = 10.0
"""Within this time a scheduler answers."""
WORKERS_S = 60.0
"""Within this time there are workers: a queue may have to start them."""
SETTINGS = {"distributed.admin.large-graph-warning-threshold": "4GB"}
"""A function with all that a series has in common is large on purpose."""
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}
"""The environment that our own workers begin in: there are as many of them as threads are wanted.
It is this process's too while they are started, which numba would take notice of."""
ONE_KERNEL_THREAD = {"NUMBA_NUM_THREADS": "1"}
"""What they set themselves, before anything of ours is loaded."""


@dataclass(eq=False)
class DaskExecutor:
    """Workers of a dask scheduler, or of a cluster on this machine that ends with the executor.

    Nothing is started or asked before the first `map`.
    """

    scheduler_address: str | None
    """None: a cluster of its own"""
    num_processes: int
    """of its own cluster, one thread each"""
    shared_path: Path | None = None
    """a folder that workers must see under the same path"""
    say: Callable[[str], None] = print
    """told once what works"""
    _stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> DaskExecutor:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @property
    def shares_memory(self) -> bool:
        """Other processes do not."""
        return False

    @property
    def num_workers(self) -> int:
        """The threads of all workers that are there now."""
        with scheduler_there():
            return max(1, sum(self._client.nthreads().values()))

    def map(self, function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
        """See `Executor`; both are pickled, and modules that they name are there on the workers."""
        import cloudpickle

        client, num_ahead = self._client, LOOK_AHEAD * self.num_workers
        name = f"{type(function).__name__}-{uuid.uuid4().hex}"
        context = None
        pending: deque[Future] = deque()
        try:
            context = self._sent_to_all(name, cloudpickle.dumps(function))
            for number, item in enumerate(items):
                with scheduler_there():
                    future = client.submit(
                        work, context, pickle.dumps(item, protocol=5), key=f"{name}-{number}"
                    )
                pending.append(future)
                if len(pending) > num_ahead:
                    yield self._result(pending.popleft())
            while pending:
                yield self._result(pending.popleft())
        finally:
            with suppress(Exception):  # a scheduler that is gone has nothing to forget
                client.cancel(list(pending))
                if context is not None:
                    context.release()

    @cached_property
    def _client(self) -> Client:
        """The connection, made when it is first asked for."""
        distributed = import_extra("distributed", "cluster")
        import dask

        # dask tells its own story on standard error; the one sentence is in the exceptions
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._stack.enter_context(dask.config.set(SETTINGS))
        address = self.scheduler_address
        try:
            if address is None:
                address = self._stack.enter_context(self._own_cluster()).scheduler_address
            client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            if self.scheduler_address is None:
                raise ClusterError(f"no cluster starts on this machine: {error}") from error
            raise UsageError(
                f"no dask scheduler answers at {address}: start one with `dask scheduler`, or "
                "leave --scheduler_address away for processes on this machine"
            ) from error
        self._stack.callback(close_quietly, client)
        self._check(client, address)
        return client

    def _own_cluster(self) -> Any:
        """Processes of one thread each on this machine, which no other one can reach."""
        import dask
        from distributed import LocalCluster

        setting = {
            f"distributed.nanny.{key}": {**dask.config.get(f"distributed.nanny.{key}", {}), **more}
            for key, more in (("pre-spawn-environ", ONE_THREAD), ("environ", ONE_KERNEL_THREAD))
        }
        with dask.config.set(setting):
            return LocalCluster(
                n_workers=self.num_processes,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                memory_limit=None,  # as threads of one process have it: the system's
                silence_logs=logging.CRITICAL,
            )

    def _check(self, client: Client, address: str) -> None:
        """Refuse workers of another version, and those that do not see the project."""
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError as error:
            raise ClusterError(
                f"the scheduler at {address} has had no workers for {WORKERS_S:.0f} s: start some "
                f"with `dask worker {address}`"
            ) from error
        token, path = uuid.uuid4().hex, None
        if self.shared_path is not None:
            path = self.shared_path.resolve() / f".semsfm-{token}.part"
            with path.open("x", encoding="ascii") as file:
                file.write(token)
        try:
            answers = client.run(introduction, path, on_error="return")
        finally:
            if path is not None:
                path.unlink(missing_ok=True)
        for worker, answer in answers.items():
            if isinstance(answer, Exception):
                raise UsageError(
                    f"the worker {worker} cannot work ({answer}): install semsfm-colmap "
                    f"{__version__} there"
                )
            version, seen = answer
            if version != __version__:
                raise UsageError(
                    f"the worker {worker} has semsfm-colmap {version} but this is {__version__}: "
                    "install the same version on all machines"
                )
            if path is not None and seen != token:
                raise UsageError(
                    f"the worker {worker} does not see {path.parent}: put the project into a "
                    "folder that all machines see under the same path"
                )
        threads = client.nthreads()
        self.say(f"dask at {address}: {len(threads)} workers, {sum(threads.values())} threads")

    def _sent_to_all(self, name: str, function: bytes) -> Future:
        """A function on every worker; dask makes it again where those that had it are gone."""
        with scheduler_there():
            context = self._client.submit(unpickled, function, key=f"{name}-function")
        self._finish(context)
        # in vain on a worker that has just died; the scheduler draws more of them than are left
        with scheduler_there(), suppress(TimeoutError, KeyError, OSError, ValueError):
            self._client.replicate(context)
        return context

    def _finish(self, future: Future) -> None:
        """Wait for a piece of work; an error in it is raised here."""
        from distributed import KilledWorker

        with scheduler_there():
            while True:
                try:
                    error = future.exception(timeout=WORKERS_S)
                    break
                except TimeoutError:
                    if not self._client.nthreads():
                        raise ClusterError(
                            f"the scheduler has had no workers for {WORKERS_S:.0f} s: start some, "
                            "and give the same command again"
                        ) from None
        if isinstance(error, KilledWorker):
            raise ClusterError(
                "several workers died at the same piece of work, perhaps for want of memory: give "
                "each more of it, or have fewer on a machine"
            )
        if error is not None:
            raise error

    def _result(self, future: Future) -> Any:
        """The result of a piece of work, waited for."""
        self._finish(future)
        with scheduler_there():
            return future.result()


@contextmanager
def scheduler_there() -> Iterator[None]:
    """What dask raises inside when its scheduler cannot be reached becomes one sentence."""
    from distributed import CancelledError
    from distributed.comm import CommClosedError

    try:
        yield
    except (CancelledError, CommClosedError) as error:
        raise ClusterError(
            "the dask scheduler is gone; what was finished is kept: start it again and give the "
            "same command, or give it with --executor local"
        ) from error


def close_quietly(client: Client) -> None:
    """Close a connection, also one whose other end is gone."""
    with suppress(Exception):
        client.close(timeout=CONNECT_S)


def introduction(path: Path | None) -> tuple[str, str | None]:
    """What a worker is: the version of this package there, and what it reads in a file."""
    try:
        return __version__, None if path is None else path.read_text(encoding="ascii")
    except OSError:
        return __version__, None


def unpickled(function: bytes) -> Any:
    """A function that was sent to a worker."""
    return pickle.loads(function)


def work(function: Callable[[Any], Any], item: bytes) -> Any:
    """Apply a function to an item in one thread: a worker has as many as it is to use."""
    from semsfm_colmap.geometry.threads import one_thread

    one_thread()
    return function(pickle.loads(item))
