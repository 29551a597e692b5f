"""The notebooks of examples/ run from top to bottom, and are kept without outputs."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import semsfm_colmap

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))


@pytest.fixture
def folder(small_series: Path, small_project: Path, tmp_path: Path) -> Path:
    """Where a notebook runs: the series that it would render and its project are there already."""
    target = tmp_path / "out" / "first_reconstruction"
    shutil.copytree(small_project, target / "project")
    for path in small_series.iterdir():
        (target / path.name).symlink_to(path)
    return tmp_path


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a notebook in a folder; what its cells printed."""
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    package = str(Path(semsfm_colmap.__file__).parents[1])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([package, os.environ.get("PYTHONPATH", "")]))
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    return "".join(out.text for out in outputs if out.output_type == "stream")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_notebooks_are_kept_without_outputs_and_say_what_they_show(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert notebook.cells[0].source.startswith("# ")
    assert "What it shows: " in notebook.cells[0].source


def test_every_notebook_is_run_by_a_test_here() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    assert [path.stem for path in NOTEBOOKS if f'run("{path.stem}"' not in text] == []


def test_first_reconstruction(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = run("first_reconstruction", folder, monkeypatch)
    assert "7 cameras" in said
    total = re.search(r"total rotation ([\d.]+) \+- ([\d.]+) deg", said)
    assert total is not None
    assert abs(float(total[1]) - 30.0) < 3.0 * float(total[2]) + 0.5
    error = re.search(r"rotation error ([\d.]+) deg", said)
    assert error is not None
    assert 0.0 < float(error[1]) < 1.0


@pytest.mark.slow
def test_measure_a_surface(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = run("measure_a_surface", folder, monkeypatch)
    length = re.search(r"standard uncertainty ([\d.]+) -> ([\d.]+) um", said)
    assert length is not None
    assert float(length[2]) < float(length[1])
    assert "Sdr" in said
    assert "of the cells have a height" in said
