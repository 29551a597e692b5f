"""A place for compiled kernels where neither package nor home folder can be written."""

import os
from pathlib import Path

import pytest

from semsfm_colmap.io import compiled


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """Nothing but the temporary folder can be written."""
    monkeypatch.delenv(compiled.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/nonexistent/cache")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    return tmp_path


def placed() -> Path:
    compiled.place_compiled(Path(compiled.__file__).parents[1])
    return Path(os.environ[compiled.VARIABLE])


def test_it_is_a_folder_of_the_users_own_and_the_same_the_next_time(nowhere, monkeypatch):
    folder = placed()
    assert folder.parent == nowhere
    assert folder.stat().st_mode & 0o777 == 0o700
    monkeypatch.delenv(compiled.VARIABLE)
    assert placed() == folder


@pytest.mark.parametrize("planted", ["link", "open to all"])
def test_a_folder_that_somebody_else_could_have_filled_is_not_used(planted, nowhere, monkeypatch):
    name = nowhere / f"semsfm-compiled-{os.getuid()}"
    if planted == "link":
        (nowhere / "theirs").mkdir()
        name.symlink_to(nowhere / "theirs", target_is_directory=True)
    else:
        name.mkdir()
        name.chmod(0o777)
    folder = placed()
    assert folder != name
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("there", ["package", "cache", "variable"])
def test_what_numba_finds_by_itself_is_left_to_it(there, nowhere, monkeypatch):
    if there == "variable":
        monkeypatch.setenv(compiled.VARIABLE, "/mine")
    elif there == "cache":
        monkeypatch.setenv("XDG_CACHE_HOME", str(nowhere))
    package = Path(compiled.__file__).parents[1]
    writable = {"package": package, "cache": nowhere, "variable": None}[there]
    monkeypatch.setattr(os, "access", lambda path, mode: path == writable)
    compiled.place_compiled(package)
    assert os.environ.get(compiled.VARIABLE) == ("/mine" if there == "variable" else None)
