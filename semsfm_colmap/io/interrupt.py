"""Ctrl-C and SIGTERM: both stop a command in the same way, whatever library is at work.

A library that is being loaded takes the exception of Ctrl-C for a failure of its own, and COLMAP's
logging puts a handler of its own in the place of SIGTERM's.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Terminated(KeyboardInterrupt):
    """SIGTERM: handled wherever Ctrl-C is."""


def terminate(number: int, frame: FrameType | None) -> None:
    """The handler of SIGTERM."""
    raise Terminated


def handle_termination() -> None:
    """Let SIGTERM stop this process as Ctrl-C does; a process that ignores it goes on ignoring."""
    if in_main_thread() and signal.getsignal(signal.SIGTERM) is not signal.SIG_IGN:
        signal.signal(signal.SIGTERM, terminate)


def in_main_thread() -> bool:
    """Python's handlers are set and run there alone."""
    return threading.current_thread() is threading.main_thread()


@contextmanager
def signals_held() -> Iterator[None]:
    """Let signals wait until a block is done, and what they had as handlers be theirs again."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    ours = {number: handler for number, handler in handlers.items() if handler is not None}
    if not in_main_thread() or not ours:
        yield
        return
    came: list[int] = []
    for number, handler in ours.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
