"""The package needs nothing that Windows and macOS lack."""

from __future__ import annotations

import json
import ntpath
import os
import subprocess
import sys
from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from semsfm_colmap.io.names import as_on_disk, leaves_folder

ROOT = Path(__file__).parents[1]
FOLDER = "C:\\project\\images"


def test_every_module_and_what_is_asked_of_the_disk_do_without_posix(tmp_path):
    script = ROOT / "tests" / "without_posix.py"
    done = subprocess.run(
        [sys.executable, script, tmp_path],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    files = (ROOT / "semsfm_colmap").rglob("*.py")
    assert len(said["modules"]) > 0.9 * len(list(files))
    assert "is in use by another semsfm process" in said["second"]
    assert said["text"] == "two"
    assert said["in_use"]
    assert said["being_written"]
    assert not said["left"]
    assert not said["held"]
    assert not said["nothing"]
    assert said["memory"] == [None, 0.0]
    assert set(said["content"]) - {".semsfm.lock"} == {
        "a.txt", "points3D.bin", "run.json", "shared.json", "sparse",
    }  # fmt: skip


TRICKY = st.text(st.sampled_from("ab.:/\\ C*\x01nulcoNCM1$"), max_size=9)


@given(TRICKY)
@example("C:a.tif")
@example("c/../../a.tif")
@example("con")
@example("a.tif:stream")
def test_a_name_that_is_taken_on_windows_is_a_file_below_the_folder(name):
    path = PureWindowsPath(FOLDER) / name
    if leaves_folder(name, windows=True):
        return
    assert ntpath.normpath(path).startswith(FOLDER + "\\")
    assert not path.is_reserved() if sys.version_info < (3, 13) else not ntpath.isreserved(path)
    assert all(ord(letter) > 31 and letter not in '<>"|?*:' for letter in name)


@given(TRICKY)
def test_what_leaves_the_folder_here_leaves_it_on_windows_too(name):
    assert leaves_folder(name, windows=True) or not leaves_folder(name, windows=False)


@pytest.mark.parametrize(
    "name",
    ["CON", "con.tif", "left/nul.png", "COM1.tif", "lpt9", "aux .tif", "a.tif.", "a ",
     "left./a.tif", "C:a.tif", "a.tif:x", "a?.tif",
     "left\\..\\a.tif", "\\\\host\\share\\a.tif", "conin$"],
)  # fmt: skip
def test_names_that_windows_does_not_have_are_refused_there(name):
    assert leaves_folder(name, windows=True)


@pytest.mark.parametrize(
    "name",
    ["a.tif", "left/a.tif", "left\\a.tif", "console.tif", "com.tif", "com10.tif", ".a", "µ.tif"],
)
def test_names_that_windows_has_are_taken_there(name):
    assert not leaves_folder(name, windows=True)


@pytest.mark.parametrize("name", ["CON.tif", "a:b.tif", "a.", "what?.tif"])
def test_names_that_only_windows_lacks_are_taken_elsewhere(name):
    assert not leaves_folder(name, windows=False)


def test_names_that_differ_by_case_alone_are_one_file_where_case_is_folded():
    names = ["left/A.png", "left/a.PNG", "STRASSE.tif", "straße.tif"]
    assert len({as_on_disk(name, folds_case=True) for name in names}) == 2
    assert len({as_on_disk(name, folds_case=False) for name in names}) == 4


def test_names_of_a_project_read_the_same_on_windows():
    stored = PurePosixPath("left/below/a.tif").as_posix()
    assert PureWindowsPath(stored).as_posix() == stored
    assert (PureWindowsPath(FOLDER) / stored).relative_to(FOLDER).as_posix() == stored
