"""Is a file still the one that was read or written? Its content tells, and for short its stamp.

Reading all images and all results at every run would take longer than many a run. So the content's
hash is kept with what the file system says of the file, as git keeps it in its index: size, time of
the last change of content and of state, and inode. While these four are the same the hash is taken
as known. A tool can set the time of the content back, and a file of the same size can take another
one's place, but neither leaves the time of state and the inode as they were.
"""

from __future__ import annotations

import time
from pathlib import Path

from semsfm_colmap.pipeline.record import hash_file

SETTLED_NS = 2_000_000_000
"""The coarsest clock of a file system in use, FAT's: what was changed later than this before it was
read may be changed again within the same tick, and is read anew next time."""
UNSETTLED = "unsettled"


def fingerprint(path: Path, known: str = "") -> str:
    """``<stamp>:<hash>`` of a file.

    Parameters
    ----------
    known : what this function said of the file before, "" for nothing

    Raises
    ------
    OSError
        It cannot be read.

    """
    status = path.stat()
    marks = (status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)
    stamp = ":".join(map(str, marks))
    if known.startswith(stamp + ":"):
        return known
    settled = time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) > SETTLED_NS
    return f"{stamp if settled else UNSETTLED}:{hash_file(path)}"


def content(found: str) -> str:
    """The hash alone of a fingerprint: what the file holds, wherever it lies."""
    return found.rsplit(":", 1)[-1]
