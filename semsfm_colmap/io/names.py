"""Names of images that come out of files: inside the folder they belong to, or refused.

A name is joined to a folder and then read or written. One that is absolute, or that climbs with
``..``, leaves the folder: what is written would land anywhere. Windows' forms are refused too, as
the same model is opened there.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from semsfm_colmap.errors import InputError

DRIVE = re.compile(r"[A-Za-z]:[\\/]")


def leaves_folder(name: str) -> bool:
    r"""Whether a name, joined to a folder, may be a place outside of it, or none.

    Examples
    --------
    >>> [leaves_folder(n) for n in ("a.tif", "left/a..b.tif", "a/../b.tif", "/a.tif", r"C:\\a.tif")]
    [False, False, True, True, True]

    """
    if not name or "\0" in name or name[0] in "/\\" or DRIVE.match(name):
        return True
    return ".." in re.split(r"[/\\]", name) or name in (".", "./")


def check_names(names: Iterable[str], source: Path | str) -> None:
    """Refuse the first name that leaves its folder.

    Raises
    ------
    InputError
        It names the file `source` and the name.

    """
    for name in names:
        if leaves_folder(name):
            raise InputError(
                f"{source} names the image {name!r}, which is no name below an image folder "
                "(absolute, empty, or with ..): rename it there"
            )
