"""Folders for the length of one step: gone when it ends, and when a run died, after the next one.

A name says nothing about whether its process still lives: it may be of another machine's namespace,
or its number given to another. So each holds a lock on its folder, which the system takes back.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from semsfm_colmap.io.atomic import aside_path
from semsfm_colmap.io.layout import FOLDERS

PREFIX = ".semsfm-"
SECONDS_UNTIL_LOCKED = 2.0
"""A folder this young may be about to be locked."""
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
    path = Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent))
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        os.close(handle)


def remove_dead_folders(parent: Path | None = None) -> None:
    """Remove the temporary folders whose process has died."""
    for path in Path(parent or tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):
            status = path.lstat()
            young = time.time() - status.st_mtime < SECONDS_UNTIL_LOCKED
            if status.st_uid != os.getuid() or not path.is_dir() or path.is_symlink():
                continue
            handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if not young or any(path.iterdir()):
                    shutil.rmtree(path, ignore_errors=True)
            finally:
                os.close(handle)


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
    if found is None or (found["process"] and _lives(int(found["process"]))):
        return
    with suppress(OSError):
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


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
