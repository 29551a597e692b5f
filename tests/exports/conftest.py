from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from semsfm_colmap.exports.scene import Summary
from semsfm_colmap.pipeline.export import export_project
from tests.exports.ball_project import write_project


@pytest.fixture(scope="session")
def plain_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished project of a ball; tests that change it copy it first."""
    return write_project(tmp_path_factory.mktemp("plain") / "p", special=False)


@pytest.fixture(scope="session")
def special_project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a space, unicode and subfolders in the image names."""
    return write_project(tmp_path_factory.mktemp("special") / "p", special=True)


@pytest.fixture(scope="session")
def plain_exports(
    plain_project: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], tuple[Path, Summary]]:
    """Folder and summary of a format, exported once."""
    done: dict[str, tuple[Path, Summary]] = {}

    def export(name: str) -> tuple[Path, Summary]:
        if name not in done:
            folder = tmp_path_factory.mktemp(name) / "out"
            done[name] = folder, export_project(plain_project, name, folder)
        return done[name]

    return export
