"""Folders for the length of one step: gone when it ends, and when a run died, after the next one.

A name says nothing about whether its process still lives: it may be of another machine's namespace,
or its number given to another. So each holds a lock in its folder, which the system takes back.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.io.atomic import aside_path, remove
from semsfm_colmap.io.layout import FOLDERS

if TYPE_CHECKING:
    from filelock import BaseFileLock

PREFIX = ".semsfm-"
LOCK = ".lock"
SECONDS_UNTIL_LOCKED = 2.0
"""A folder this young may be about to be locked."""
SECONDS_OF_WRITING = 24 * 3600.0
"""What was left aside longer ago than this is of a process that has died."""
LEFT_ASIDE = re.compile(
    r"^\.(?P<name>.+?)(\.(?P<process>\d+))?\.(?P<kind>part|old)(-wal|-shm|-journal)?$"
)
"""What `io.atomic` and the scratch database call things while they are written."""


@contextmanager
def temporary_folder(parent: Path | None = None) -> Iterator[Path]:
    """An empty folder, removed with all in it when the block ends.

    Parameters
    ----------
    parent : where; default: where the system has such things

    """
    from filelock import FileLock

    path = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
    lock = FileLock(path / LOCK)
    try:
        lock.acquire()
        yield path
    finally:
        _remove_held(path, lock)


def _remove_held(path: Path, lock: BaseFileLock) -> None:
    """Remove a folder whose lock is ours; some systems keep an open file, and the folder with it.

    All else goes before the lock is given back, so that nobody takes half of it for something dead.
    """
    for entry in content_of(path):
        remove(entry)
    lock.release()
    shutil.rmtree(path, ignore_errors=True)


def remove_dead_folders(parent: Path | None = None) -> None:
    """Remove the temporary folders whose process has died."""
    from filelock import FileLock, Timeout

    for path in Path(parent or tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):
            status = path.lstat()
            young = time.time() - status.st_mtime < SECONDS_UNTIL_LOCKED
            if not _is_ours(status) or not path.is_dir() or path.is_symlink():
                continue
            if young and not content_of(path):
                continue
            if (path / LOCK).is_symlink():  # planted: whoever opens it writes elsewhere
                remove(path / LOCK)
            with suppress(Timeout):
                lock = FileLock(path / LOCK)
                lock.acquire(timeout=0)
                _remove_held(path, lock)


def content_of(folder: Path) -> list[Path]:
    """What a temporary folder holds beside its lock."""
    return [entry for entry in folder.iterdir() if entry.name != LOCK] if folder.is_dir() else []


def _is_ours(status: os.stat_result) -> bool:
    """Whether a folder is this user's; where users have no numbers each has a folder of his own."""
    return not hasattr(os, "getuid") or status.st_uid == os.getuid()


def remove_leftovers(project_path: Path) -> None:
    """Remove what killed runs have left aside in a project that is held.

    A folder that was moved out of the way when the run died, before another took its place, is put
    back.
    """
    remove_dead_folders()
    for place in (project_path, *(project_path / name for name in FOLDERS)):
        for folder, folders, files in os.walk(place):
            remove_dead_folders(Path(folder))
            for name in [*folders, *files]:
                _remove_aside(Path(folder, name))
            folders[:] = [f for f in folders if not f.startswith(".") and place != project_path]


def _remove_aside(path: Path) -> None:
    found = LEFT_ASIDE.match(path.name)
    if found is None:
        return
    with suppress(OSError):
        if found["process"] and _is_being_written(path, int(found["process"])):
            return
        original = path.with_name(found["name"])
        if (
            found["kind"] == "old"
            and not original.exists()
            and path == aside_path(original, ".old")
        ):
            path.rename(original)
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()


def _is_being_written(path: Path, process: int) -> bool:
    """Whether the process that names a file lives; on Windows to ask that would end the process."""
    if sys.platform == "win32":
        return time.time() - path.lstat().st_mtime < SECONDS_OF_WRITING
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
