"""`semsfm compare` on two project folders."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.io.ply import read_ply_mesh, write_ply
from semsfm_colmap.metrology.heights.files.registry import read_height_map
from semsfm_colmap.pipeline.compare_surfaces import compare_projects
from tests.exports.ball_project import UNIT, write_project
from tests.metrology.heights.surfaces import rough, sheet
from tests.surface.scene import SCALE

PX = UNIT / SCALE
"""Micrometres in a px"""
Y, X = np.mgrid[0:90, 0:100].astype(float)
TRUTH = rough(90, 100, 30.0, 8.0, seed=1)
PIT = -6.0 * np.exp(-(((X - 60.0) / 9.0) ** 2) - ((Y - 40.0) / 9.0) ** 2)
STEP = 3.0


@pytest.fixture(scope="module")
def projects(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Before and after, the second one turned; cells of 3 px."""
    folder = tmp_path_factory.mktemp("two")
    before = write_project(folder / "before", special=False)
    after = shutil.copytree(before, folder / "after")
    for path, z, turn in ((before, TRUTH, 0.0), (after, TRUTH + PIT, 1.1)):
        mesh = sheet(z, STEP, sigma=0.4)
        R = rotation_from_vector(np.array([[0.1, 0.3, turn]]))[0]
        placed = replace(
            mesh, vertices=PX * mesh.vertices @ R.T, vertex_sigma=PX * mesh.vertex_sigma
        )
        write_ply(path / "mesh" / "mesh.ply", placed)
    return before, after


def test_the_volume_lost_and_its_map_are_written(projects, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["compare", *map(str, projects), "--output_path", str(out), "--to", "tif,x3p"]) == 0
    data = json.loads((out / "comparison.json").read_text())
    volume = -PIT.sum() * STEP**2 * PX**3
    lost = data["volume_lost"]
    assert lost["unit"] == "um^3"
    assert abs(lost["value"] - volume) < 3.0 * lost["sigma"]
    assert lost["value"] > 10.0 * lost["sigma"]
    assert data["volume_gained"]["value"] == 0.0
    found = read_height_map(out / "difference.x3p")
    assert np.nanmin(found.z) == pytest.approx(-6.0 * PX, rel=0.1)
    assert (out / "difference.png").is_file()
    assert "volume lost" in "".join(capsys.readouterr())
    # a comparison may be made again, another folder is never overwritten
    compare_projects(*projects, out)


def test_a_folder_that_is_no_comparison_is_not_overwritten(projects, tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(UsageError, match="is no comparison"):
        compare_projects(*projects, tmp_path / "mine")


def test_unequal_units_are_refused(projects, tmp_path):
    other = shutil.copytree(projects[1], tmp_path / "px")
    sidecar = other / "sparse" / "0" / "orthographic.json"
    said = json.loads(sidecar.read_text()) | {"world_unit": "px", "pixel_size": None}
    sidecar.write_text(json.dumps(said))
    with pytest.raises(InputError, match=r"in um and .* in px: give the pixel size"):
        compare_projects(projects[0], other, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_project_that_is_not_there_is_named(projects, tmp_path):
    with pytest.raises(UsageError, match="nowhere is not a folder"):
        compare_projects(projects[0], tmp_path / "nowhere", tmp_path / "out")


def test_a_whole_ball_is_refused_and_a_region_of_it_has_not_changed(tmp_path):
    before = write_project(tmp_path / "a", special=False)
    path = before / "mesh" / "mesh.ply"
    ball = read_ply_mesh(path)
    write_ply(path, replace(ball, vertex_sigma=np.full(len(ball.vertices), 0.5 * PX)))
    with pytest.raises(InputError, match=r"closed or overhanging.*--region"):
        compare_projects(before, before, tmp_path / "out")
    data = compare_projects(
        before, before, tmp_path / "out", region=(50.0, 30.0, 110.0, 90.0), spacing=2.0 * PX
    )
    assert data["volume_lost"]["value"] == data["volume_gained"]["value"] == 0.0
    assert abs(data["volume_net"]["value"]) < data["volume_net"]["sigma"]
