"""`semsfm example`: the example of the README as a command."""

import shutil
import sys
from pathlib import Path

import pytest

from semsfm_colmap.cli.main import main


@pytest.fixture
def folder(tmp_path, small_series, small_project):
    """A folder in which a small series and its project stand in the place of the example's."""
    (tmp_path / "series").symlink_to(small_series, target_is_directory=True)
    shutil.copytree(small_project, tmp_path / "project")
    return tmp_path


def test_it_ends_with_the_places_of_mesh_model_and_report_and_keeps_what_is_there(folder, capsys):
    before = (folder / "project/mesh/mesh.ply").stat().st_mtime_ns
    assert main(["example", "--output_path", str(folder)]) == 0
    said = capsys.readouterr().out
    places = dict(line.split(":", 1) for line in said.splitlines()[-3:])
    assert places.keys() == {"mesh", "COLMAP model", "report"}
    for place in places.values():
        assert Path(place.split(" (")[0].strip()).exists()
    assert "rotation error" in said
    assert (folder / "project/mesh/mesh.ply").stat().st_mtime_ns == before


def test_a_rendering_that_was_stopped_leaves_no_half_series(tmp_path, monkeypatch):
    def stopped(path, options, progress):
        (path / "images").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr("semsfm_colmap.synthetic.series.synthesize", stopped)
    assert main(["example", "--output_path", str(tmp_path / "out")]) == 130
    assert list((tmp_path / "out").iterdir()) == []


def test_without_open3d_it_says_what_to_type_before_anything_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "open3d", None)
    assert main(["example", "--output_path", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert 'pip install "semsfm-colmap[mesh]"' in said
    assert not (tmp_path / "out").exists()
