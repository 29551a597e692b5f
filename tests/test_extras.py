"""The core without what the extras bring: open3d and the others are blocked."""

import shutil
import subprocess
import sys

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.io.extras import EXTRAS
from semsfm_colmap.pipeline.doctor import MODULE_OF, libraries

BLOCKED = [
    MODULE_OF.get(name, name.replace("-", "_")) for extra in EXTRAS for name in libraries(extra)
]
"""Modules of the distributions that pyproject.toml has in the extras."""


@pytest.fixture
def core(monkeypatch):
    """An installation without extras, as far as imports can tell."""
    for name in BLOCKED:
        monkeypatch.setitem(sys.modules, name, None)


def test_every_module_imports_without_the_extras():
    code = f"""
import importlib, pkgutil, sys
sys.modules.update(dict.fromkeys({BLOCKED!r}))
import semsfm_colmap
for module in pkgutil.walk_packages(semsfm_colmap.__path__, "semsfm_colmap."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(len(sys.modules))
"""
    assert {"open3d", "xatlas", "skimage", "distributed"} <= set(BLOCKED)
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "command",
    [
        ["map", "PROJECT", "--force"],
        ["densify", "PROJECT"],
        ["report", "PROJECT", "--force"],
        ["export", "PROJECT", "--to", "ply", "--output_path", "OUT"],
    ],
)
def test_the_core_goes_from_matches_to_report_without_open3d(
    command, core, small_project, tmp_path, capsys
):
    project = tmp_path / "p"
    shutil.copytree(small_project, project)
    words = {"PROJECT": str(project), "OUT": str(tmp_path / "out")}
    code = main([words.get(word, word) for word in command])
    assert code == 0, capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        (["mesh", "PROJECT", "--force"], "mesh"),
        (["mesh", "--colmap_path", "PROJECT"], "mesh"),
        (["synthesize", "OUT", "--example"], "mesh"),
        (["evaluate", "PROJECT", "SERIES"], "mesh"),
        (["export", "PROJECT", "--to", "stl", "--output_path", "OUT"], "mesh"),
        (["match", "PROJECT", "--force", "--executor", "dask"], "cluster"),
    ],
)
def test_a_missing_extra_is_one_sentence_before_any_work(
    command, extra, core, small_project, small_series, tmp_path, capsys
):
    words = {"PROJECT": small_project, "SERIES": small_series, "OUT": tmp_path / "out"}
    assert main([str(words.get(word, word)) for word in command]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert said.endswith(f'run `pip install "semsfm-colmap[{extra}]"`\n')
    assert not (tmp_path / "out").exists()
