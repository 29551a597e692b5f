"""Names of images that come out of files: inside the folder they belong to, or refused.

A name is joined to a folder and then read or written. One that is absolute, or that climbs with
``..``, leaves the folder: what is written would land anywhere. Windows' forms are refused too, as
the same model is opened there. On Windows itself names that mean a device, a stream of another file
or, without their last dot, another file are refused besides.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

from semsfm_colmap.errors import InputError

DRIVE = re.compile(r"[A-Za-z]:[\\/]")
SEPARATORS = re.compile(r"[/\\]")
WINDOWS_DEVICE = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9\u00b9\u00b2\u00b3]) *(\..*)?", re.I
)
"""With any ending [Microsoft, Naming Files, Paths, and Namespaces], which has what follows, too."""
NOT_ON_WINDOWS = re.compile(r'[<>:"|?*\x00-\x1f]|[. ]$')


def leaves_folder(name: str, *, windows: bool = sys.platform == "win32") -> bool:
    r"""Whether a name, joined to a folder, may be a place outside of it, or none.

    Parameters
    ----------
    name : as a file has it
    windows : the folder is there

    Examples
    --------
    >>> [leaves_folder(n) for n in ("a.tif", "left/a..b.tif", "a/../b.tif", "/a.tif", r"C:\\a.tif")]
    [False, False, True, True, True]
    >>> [leaves_folder(n, windows=True) for n in ("a.tif", "con.tif", "C:a.tif", "a./b.tif")]
    [False, True, True, True]

    """
    if not name or "\0" in name or name[0] in "/\\" or DRIVE.match(name):
        return True
    parts = SEPARATORS.split(name)
    if windows and any(WINDOWS_DEVICE.fullmatch(p) or NOT_ON_WINDOWS.search(p) for p in parts):
        return True
    return ".." in parts or name in (".", "./")


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
                "(absolute, empty, with .., or none that this system has): rename it there"
            )


def as_on_disk(name: str, *, folds_case: bool = sys.platform in ("win32", "darwin")) -> str:
    """What two names share that are one file: on some systems A.png and a.png are.

    Parameters
    ----------
    folds_case : the system tells no small letters from capital ones

    """
    return name.casefold() if folds_case else name
