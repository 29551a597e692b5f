"""Files and folders written whole or not at all: aside first, then renamed.

Who looks sees the old one or the new one, and never half of either, after a power cut too: what is
aside reaches the disk before it is renamed, and its name after. What a killed process left aside is
overwritten when the same thing is written again.
"""

from __future__ import annotations

import glob
import json
import os
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.disk import full_disk_is_said, sync, to_disk

MAX_NAME_BYTES = 200
"""File systems take names of 255 bytes: longer ones than this are cut aside."""

UNFINISHED = ".unfinished"
"""Ending of folders that a later run goes on with: what ends with .part is removed by the next."""


def aside_path(path: Path, suffix: str = ".part", *, shared: bool = False) -> Path:
    """A hidden name beside `path`: its own, cut where it is long.

    Parameters
    ----------
    shared : two processes may write the file at a time: each takes a name of its own. What is
        written into a project needs none, it is locked, and finds its leftovers again.

    """
    name, whole = path.name, os.fsencode(path.name)
    while len(os.fsencode(name)) > MAX_NAME_BYTES:
        name = name[:-1]  # whole characters: not every system takes half of one
    if name != path.name:
        # long names often differ at their end
        name = f"{name}.{zlib.crc32(whole):08x}"
    process = f".{os.getpid()}" if shared else ""
    return path.with_name(f".{name}{process}{suffix}")


@contextmanager
def file_aside(path: Path, *, suffix: str = ".part", shared: bool = False) -> Iterator[Path]:
    """Where to write a file that takes the place of `path` when the block ends.

    It is there, empty, and a file of its own. When the block fails, what it wrote is removed and
    `path` is as it was.

    Parameters
    ----------
    suffix : of its name, where a writer tells formats apart by the ending
    shared : as in `aside_path`

    """
    with full_disk_is_said(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = aside_path(path, suffix, shared=shared)
        make_new(aside)
    try:
        with full_disk_is_said(path):
            yield aside
            sync(aside)
            os.replace(aside, path)
            sync(path.parent)
    except BaseException:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        raise


@contextmanager
def folder_aside(path: Path) -> Iterator[Path]:
    """An empty folder that takes the place of `path` as a whole when the block ends.

    When the block fails, it is removed and `path` is as it was.
    """
    aside = aside_path(path)
    remove(aside)
    try:
        with full_disk_is_said(path), _put_in_place(aside, path):
            yield aside
    except BaseException:
        remove(aside)
        raise


@contextmanager
def folder_filled(path: Path, key: str, *, fresh: bool) -> Iterator[Path]:
    """A folder that takes the place of `path` when the block ends, and is kept aside if it fails.

    For what is made file by file, each worth keeping: the same block goes on after a kill.

    Parameters
    ----------
    key : hash of all that shapes the files; what was left of another key is removed
    fresh : begin with an empty folder, whatever was left

    """
    aside = aside_path(path, f".{key[:16]}{UNFINISHED}")
    for left in path.parent.glob(f".{glob.escape(path.name)}.*{UNFINISHED}"):
        if fresh or left != aside or left.is_symlink():
            remove(left)
    with full_disk_is_said(path), _put_in_place(aside, path):
        yield aside


@contextmanager
def _put_in_place(aside: Path, path: Path) -> Iterator[None]:
    aside.mkdir(parents=True, exist_ok=True)
    yield
    to_disk(aside)
    replace_folder(aside, path)
    sync(path.parent)


def replace_folder(aside: Path, path: Path) -> None:
    """Put a finished folder in the place of an older one, which has no call of its own."""
    old = aside_path(path, ".old")
    remove(old)
    if os.path.lexists(path):
        os.rename(path, old)
    os.rename(aside, path)
    remove(old)


def make_new(path: Path) -> None:
    """An empty file of our own, whatever was there: a link that somebody planted under the name is
    taken away, not followed.
    """
    remove(path)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    os.close(os.open(path, flags, 0o666))


def remove(path: Path) -> None:
    """Take a leftover away, as far as that can be: a folder with all in it, a link without."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def write_bytes(content: bytes, path: Path, *, shared: bool = False) -> None:
    """Write a file; UsageError when that cannot be done."""
    try:
        with file_aside(path, shared=shared) as aside:
            aside.write_bytes(content)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written ({error.strerror or error}); check the output folder."
        ) from error


def write_text(text: str, path: Path, *, shared: bool = False) -> None:
    """Write a text in UTF-8; UsageError when that cannot be done."""
    write_bytes(text.encode("utf-8"), path, shared=shared)


def write_json(data: Any, path: Path, *, shared: bool = False) -> None:
    """Write JSON, numpy numbers as plain ones; UsageError when that cannot be done."""
    write_text(json.dumps(data, indent=1, default=float) + "\n", path, shared=shared)
