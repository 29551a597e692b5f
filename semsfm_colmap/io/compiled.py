"""Where numba keeps what it has compiled: beside the package, or in the user's cache folder.

An installation that only root may write to, used by somebody without a home folder (a container, a
service, a job of a cluster), has neither, and numba would refuse to compile. It then gets a folder
of the user's own among the temporary ones: its files are executed, so nobody else may own it.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"


def place_compiled(package: Path) -> None:
    """Set `NUMBA_CACHE_DIR` where numba would find no place by itself.

    Parameters
    ----------
    package : folder of the package

    """
    if VARIABLE in os.environ or os.access(package, os.W_OK) or _can_be_made(user_cache()):
        return
    import tempfile

    own = None
    if hasattr(os, "getuid"):
        own = Path(tempfile.gettempdir(), f"semsfm-compiled-{os.getuid()}")
    if own is None or not _is_mine(own):
        own = Path(tempfile.mkdtemp(prefix="semsfm-compiled-"))
    os.environ[VARIABLE] = str(own)


def user_cache() -> Path:
    """The folder in which numba looks for one of the user's own."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))


def _can_be_made(folder: Path) -> bool:
    there = next(path for path in (folder, *folder.parents) if path.exists())
    return os.access(there, os.W_OK)


def _is_mine(folder: Path) -> bool:
    """A folder that nobody else may write to; made where it is not there."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    mine = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return mine and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
