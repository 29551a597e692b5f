"""Versions of the files that one run writes and a later one reads.

Beside its format a file says a version: a whole number that is raised when a reader of the last one
would misread the new one. Keys that are only added raise nothing, as readers pass over those that
they do not know. All versions up to the program's own are read; a newer one is refused, as nobody
here can know what it means.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from semsfm_colmap.errors import InputError
from semsfm_colmap.version import __version__


def check_version(content: Mapping[str, Any], newest: int, source: Path, again: str) -> None:
    """Refuse what a newer program has written.

    Parameters
    ----------
    content : of the file
    newest : the highest version that is read
    source : the file
    again : what makes it again, where it is damaged

    Raises
    ------
    InputError
        The version is higher, or is none at all.

    """
    found = content.get("version")
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise InputError(f"{source} is damaged (version = {found!r}): {again}")
    if found > newest:
        raise InputError(
            f"{source} was written by a newer semsfm (its version is {found}, semsfm {__version__} "
            f"reads up to {newest}): update this one (pip install -U semsfm-colmap)"
        )
