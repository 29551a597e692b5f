"""What the user hears of a run: sentences, warnings and progress, on the console and in the log."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from semsfm_colmap.io.printable import printable
from semsfm_colmap.pipeline.progress import display, phases_shown

LOGGER = logging.getLogger("semsfm")


class Reporter:
    """Sentences and progress, to the console and to semsfm.log."""

    def __init__(self, verbosity: int = 0) -> None:
        self.verbosity = verbosity
        self._handlers: list[logging.Handler] = []
        self._buffer: list[str] = []
        self._file: Path | None = None

    def log_to(self, path: Path) -> None:
        """Append to a log file from now on, what was said before included."""
        if self._file == path:
            return
        handler = logging.FileHandler(path, encoding="utf-8")
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%Y-%m-%d %H:%M:%S"))
        LOGGER.setLevel(logging.INFO)
        LOGGER.propagate = False
        LOGGER.addHandler(handler)
        self._handlers.append(handler)
        self._file = path
        for line in self._buffer:
            LOGGER.info(line)
        self._buffer.clear()

    def close(self) -> None:
        """Let go of the log file."""
        for handler in self._handlers:
            LOGGER.removeHandler(handler)
            handler.close()
        self._handlers.clear()
        self._file = None

    def _record(self, line: str) -> None:
        if self._file is None:
            self._buffer.append(line)
        else:
            LOGGER.info(line)

    def say(self, line: str) -> None:
        """A line for everybody who did not ask for quiet."""
        line = printable(line, keep="\n\t")
        self._record(line)
        if self.verbosity >= 0:
            print(line, file=sys.stderr, flush=True)

    def detail(self, line: str) -> None:
        """A line for the log, and for the console with -v."""
        line = printable(line, keep="\n\t")
        self._record(line)
        if self.verbosity > 0:
            print(f"  {line}", file=sys.stderr, flush=True)

    def warn(self, line: str) -> None:
        """A warning: always shown, kept for the report."""
        line = printable(line)
        self._record(f"warning: {line}")
        print(f"warning: {line}", file=sys.stderr, flush=True)

    @contextmanager
    def progress(self, label: str) -> Iterator[Callable[[int, int], None]]:
        """A function (done, total) to call now and then."""
        if self.verbosity < 0:
            yield lambda done, total: None
            return
        with display() as show:
            show(label, 0.0)
            yield lambda done, total: show(label, done / max(total, 1))

    @contextmanager
    def phases(
        self, name: str, shares: Mapping[str, float]
    ) -> Iterator[Callable[[str, int, int], None]]:
        """A function (phase, done, total) to call now and then.

        Parameters
        ----------
        shares : of the time that each phase takes, see `phases_shown`

        """
        if self.verbosity < 0:
            yield lambda phase, done, total: None
            return
        with display() as show:
            yield phases_shown(name, shares, show)
