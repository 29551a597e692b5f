from __future__ import annotations

from pathlib import Path

import pytest

from tests.colmap.exports.ball_project import write_project


@pytest.fixture(scope="session")
def plain_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished project of a ball; tests that change it copy it first."""
    return write_project(tmp_path_factory.mktemp("plain") / "p", special=False)


@pytest.fixture(scope="session")
def special_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a space, unicode and subfolders in the image names."""
    return write_project(tmp_path_factory.mktemp("special") / "p", special=True)
