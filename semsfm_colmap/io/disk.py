"""A full disk, whichever library runs into it first, and what must survive a power cut.

numpy, SQLite, COLMAP and open3d each say something else when nothing more can be written, and some
say nothing and leave half a file. So what fails while there is no space left has failed for that.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from semsfm_colmap.errors import DiskFullError

FULL = frozenset(
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG") if hasattr(errno, name)
)
"""No space, no quota, or the limit of `ulimit -f`."""
SENTENCES = ("disk is full", "no space left", "file too large")
MIN_FREE_BYTES = 1 << 16
"""With less than this left even a database of nothing cannot be made."""


@contextmanager
def full_disk_is_said(path: Path) -> Iterator[None]:
    """Turn whatever fails for want of space into one sentence.

    Parameters
    ----------
    path : what is written, or the folder that it is written to

    Raises
    ------
    DiskFullError
        In the place of any other error while the disk is full.

    """
    try:
        yield
    except DiskFullError:
        raise
    except Exception as error:
        if out_of_space(error) or is_full(path):
            raise full_disk_error(path) from error
        raise


def full_disk_error(path: Path) -> DiskFullError:
    """The sentence."""
    if _file_limit() is not None and not _little_space(path):
        return DiskFullError(
            f"{path}: a file reaches the largest size that `ulimit -f` allows: raise it, and run "
            "the same command again; what was finished is kept"
        )
    return DiskFullError(
        f"{path}: the disk is full (No space left on device): free some space there, and run the "
        "same command again; what was finished is kept"
    )


def out_of_space(error: BaseException | None) -> bool:
    """Whether an error, or one that led to it, says that nothing more can be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        if any(words in str(error).lower() for words in SENTENCES):
            return True
        error = error.__cause__ or error.__context__
    return False


def is_full(path: Path) -> bool:
    """Whether nothing of any size can be written there, for want of space or by a limit."""
    return _little_space(path) or _at_limit(path)


def _little_space(path: Path) -> bool:
    return _free_bytes(path) < MIN_FREE_BYTES


def _free_bytes(path: Path) -> float:
    """Infinite where the system does not say."""
    while not path.exists() and path != path.parent:
        path = path.parent
    try:
        return shutil.disk_usage(path).free
    except OSError:
        return float("inf")


def _at_limit(path: Path) -> bool:
    """Whether a file has come to the size that this process may write."""
    limit = _file_limit()
    if limit is None:
        return False
    files = path.rglob("*") if path.is_dir() else [path]
    return any(_size(file) > limit - MIN_FREE_BYTES for file in files)


def _file_limit() -> int | None:
    """Of `ulimit -f`; None without, and on Windows, which has none."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:
        return 0


def require_space(path: Path, num_bytes: int) -> None:
    """Refuse to begin what would not fit, where running out of space ends the process.

    Parameters
    ----------
    path : the file that grows, or is made
    num_bytes : by how much, at most

    Raises
    ------
    DiskFullError
        There is less, or the file would pass the limit of `ulimit -f`.

    """
    place = path.parent
    limit = _file_limit()
    if _free_bytes(place) < num_bytes or (limit is not None and _size(path) + num_bytes > limit):
        raise full_disk_error(place)


def to_disk(path: Path) -> None:
    """Let a file or folder, with all below it, survive a power cut from here on."""
    if path.is_dir() and not path.is_symlink():
        for entry in path.iterdir():
            to_disk(entry)
    sync(path)


def sync(path: Path) -> None:
    """The same of a file, or of the names in a folder alone."""
    with suppress(FileNotFoundError, PermissionError):
        # Windows opens no folders, and brings to the disk only what is open for writing
        handle = os.open(path, os.O_RDWR if sys.platform == "win32" else os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EROFS):  # a file system without
                raise
        finally:
            os.close(handle)
