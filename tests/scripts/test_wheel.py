"""The wheel and the sdist: what is in them, and that one makes the other."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from semsfm_colmap import __version__

ROOT = Path(__file__).parents[2]


def build(kind: str, tree: Path, folder: Path) -> Path:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)],
        cwd=tree,
        check=True,
        capture_output=True,
    )
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "semsfm_colmap"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    names = set(zipfile.ZipFile(wheel).namelist())
    info = f"semsfm_colmap-{__version__}.dist-info"
    assert {name for name in names if not name.startswith(info)} == set(listed.stdout.split())
    assert {name.removeprefix(info) for name in names if name.startswith(info)} == {
        "/METADATA", "/WHEEL", "/entry_points.txt", "/licenses/LICENSE", "/RECORD"
    }  # fmt: skip


def test_the_sdist_makes_the_same_wheel(wheel, tmp_path):
    with tarfile.open(build("sdist", ROOT, tmp_path / "sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
    tree = tmp_path / f"semsfm_colmap-{__version__}"
    assert not (tree / "tests").exists()
    again = build("wheel", tree, tmp_path / "wheel")
    assert again.name == wheel.name
    assert again.read_bytes() == wheel.read_bytes()
