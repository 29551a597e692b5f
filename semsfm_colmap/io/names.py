"""Names of images that come out of files: inside the folder they belong to, or refused.

A name is joined to a folder and then read or written. One that is absolute, or that climbs with
``..``, leaves the folder: what is written would land anywhere. Windows' forms are refused too, as
the same model is opened there. On Windows itself names that mean a device, a stream of another file
or, without their last dot, another file are refused besides.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

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


def name_keys(name: str) -> tuple[str, str, str, str]:
    """What names of one image may share in two programs, the closest first.

    The name, without suffix (a PNG made from a TIFF), of the file alone (a folder above or below),
    and both.

    Examples
    --------
    >>> name_keys("left/a.tif")
    ('left/a.tif', 'left/a', 'a.tif', 'a')

    """
    path = PurePosixPath(name)
    return name, str(path.with_suffix("")) if path.name else name, path.name, path.stem


def same_images(wanted: Sequence[str], there: Sequence[str]) -> dict[str, str]:
    """Names of `there` that mean those of `wanted`, by the first key that all of them share.

    Returns
    -------
    the wanted name of each name there that means one; where no key finds all that are wanted and
    tells them apart, only of names that are the same

    Examples
    --------
    >>> same_images(["a.png", "b.png"], ["in/b.tif", "in/a.tif", "in/c.tif"])
    {'in/a.tif': 'a.png', 'in/b.tif': 'b.png'}

    """
    for level in range(len(name_keys(""))):
        by_key: dict[str, list[str]] = {}
        for name in there:
            by_key.setdefault(name_keys(name)[level], []).append(name)
        keys = [name_keys(name)[level] for name in wanted]
        if len(set(keys)) == len(keys) and all(len(by_key.get(key, ())) == 1 for key in keys):
            return {by_key[key][0]: name for key, name in zip(keys, wanted, strict=True)}
    return {name: name for name in there if name in set(wanted)}
