"""What the user hears of a run: sentences, warnings and progress, on the console and in the log."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from semsfm_colmap.io.terminal import printable_line, tell
from semsfm_colmap.pipeline.progress import display, phases_shown

LOGGER = logging.getLogger("semsfm")


class LogFile(logging.FileHandler):
    """A log that is no reason to fail: on a full disk the run says so itself."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Pass over a line that cannot be written."""


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
        if path.is_symlink():  # whoever planted it chose what would be written to
            path.unlink()
        handler = LogFile(path, encoding="utf-8")
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
            with suppress(OSError):
                handler.close()
        self._handlers.clear()
        self._file = None

    def _record(self, line: str) -> None:
        line = printable_line(line)
        if self._file is None:
            self._buffer.append(line)
        else:
            LOGGER.info(line)

    def say(self, line: str) -> None:
        """A line for everybody who did not ask for quiet."""
        self._record(line)
        if self.verbosity >= 0:
            tell(line)

    def detail(self, line: str) -> None:
        """A line for the log, and for the console with -v."""
        self._record(line)
        if self.verbosity > 0:
            tell(f"  {line}")

    def warn(self, line: str) -> None:
        """A warning: always shown, kept for the report."""
        self._record(f"warning: {line}")
        tell(f"warning: {line}")

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
