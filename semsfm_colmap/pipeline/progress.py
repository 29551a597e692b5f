"""How far a stage has come and how long it takes from here.

A bar on a terminal, one line that changes in a notebook, lines elsewhere.

Time left is what has passed times the rest over what is done. A stage of several phases is told
their usual shares of its time, so that one bar runs through all of them.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from itertools import accumulate
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.text import Text

SECONDS_BETWEEN_LINES = 5.0
SECONDS_IN_NOTEBOOK = 1.0
MIN_SHARE = 0.02
"""With less done nothing is said of the time left."""

Display = Callable[[str, float], None]
"""Called with what is being done and the share that is, 0 to 1."""


def duration(seconds: float) -> str:
    """``8 s``, ``2 min 5 s``, ``1 h 20 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def time_left(elapsed: float, share: float) -> str:
    """``about 8 s left``; empty while too little is done to say."""
    if not MIN_SHARE <= share < 1.0:
        return ""
    return f"about {duration(elapsed * (1.0 - share) / share)} left"


def line(label: str, share: float, elapsed: float) -> str:
    """``depth maps: 40 %, about 12 s left``; how long it takes already where nothing is known."""
    left = time_left(elapsed, share)
    return f"{label}: {100 * share:.0f} %, {left}" if left else f"{label}: {duration(elapsed)}"


@contextmanager
def display() -> Iterator[Display]:
    """A bar where stderr is a terminal, a line below the cell of a notebook, else lines."""
    if sys.stderr.isatty():
        chosen = _bar()
    elif in_notebook():
        chosen = _line_of_cell()
    else:
        chosen = _lines(_print, SECONDS_BETWEEN_LINES)
    with chosen as show:
        yield show


def in_notebook() -> bool:
    """Whether a kernel runs this, whose front end shows what is displayed."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def _print(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def _line_of_cell() -> Iterator[Display]:
    """A line below the cell that each text replaces, empty at the end."""
    display: Any = import_module("IPython.display").display
    handle = display({"text/plain": ""}, raw=True, display_id=True)

    def put(text: str) -> None:
        handle.update({"text/plain": text}, raw=True)

    with _lines(put, SECONDS_IN_NOTEBOOK) as show:
        yield show
    put("")


@contextmanager
def _lines(put: Callable[[str], None], seconds: float) -> Iterator[Display]:
    """Lines come from a thread of their own: also of what calls nobody for a minute."""
    begin, ended = time.monotonic(), threading.Event()
    now: list[tuple[str, float]] = []

    def speak() -> None:
        while not ended.wait(seconds):
            if now and now[-1][1] < 1.0:
                put(f"  {line(*now[-1], time.monotonic() - begin)}")

    def show(label: str, share: float) -> None:
        now[:] = [(label, share)]

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    try:
        yield show
    finally:
        ended.set()
        speaker.join()


@contextmanager
def _bar() -> Iterator[Display]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        """Time passed, and about how much is left."""

        def render(self, task: Task) -> Text:
            elapsed = task.elapsed or 0.0
            left = time_left(elapsed, float(task.completed))
            return Text(", ".join([duration(elapsed), *([left] if left else [])]))

    columns: list[Any] = [
        TextColumn("  {task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeLeft(),
    ]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks: list[TaskID] = []  # none until there is something to show

        def show(label: str, share: float) -> None:
            if not tasks:
                tasks.append(bar.add_task(label, total=1.0))
            bar.update(tasks[0], description=label, completed=share)

        yield show


def phases_shown(
    name: str, shares: Mapping[str, float], show: Display
) -> Callable[[str, int, int], None]:
    """A function (phase, done, total) that moves one display through the phases of a stage.

    Parameters
    ----------
    shares : of the stage's time, in the order of the phases; their sum is 1
    show : what to move; it never goes back, though a phase may come again

    """
    starts = dict(zip(shares, accumulate(shares.values(), initial=0.0), strict=False))
    reached = 0.0

    def step(phase: str, done: int, total: int) -> None:
        nonlocal reached
        reached = max(reached, starts[phase] + shares[phase] * done / max(total, 1))
        show(f"{name}: {phase}", min(reached, 1.0))

    return step
