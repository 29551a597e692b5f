"""STL and 3MF as other programs read them: millimetres, to scale, closed where that was asked."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.io.ply import write_ply
from semsfm_colmap.pipeline.export import export_project
from semsfm_colmap.pipeline.foreign.mesh_colmap import mesh_colmap
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.colmap.perspective_models import RADIUS as BALL_RADIUS
from tests.colmap.perspective_models import around, ball, perspective_model, write_model
from tests.exports.ball_project import UNIT
from tests.surface.scene import RADIUS, ball_points

BOTH = pytest.mark.parametrize("name", ["stl", "3mf"])
RADIUS_UM = RADIUS * UNIT


@pytest.fixture
def project(plain_project: Path, tmp_path: Path) -> Path:
    """The ball's project with the mesh of the side that its images see, and its hull instead."""
    path = tmp_path / "p"
    shutil.copytree(plain_project, path)
    return path


def put_mesh(project: Path, *, watertight: bool) -> None:
    points = ball_points(3000)
    points = points[points[:, 2] < 0.5 * RADIUS]
    cloud = PointCloud(points=points * UNIT, normals=points / RADIUS)
    mesh = mesh_cloud(cloud, SurfaceOptions(watertight=watertight))
    write_ply(project / "mesh" / "mesh.ply", mesh)


def read(folder: Path, name: str) -> trimesh.Trimesh:
    return trimesh.load(folder / f"mesh.{name}", force="mesh")


@BOTH
def test_a_micrometre_is_a_millimetre_without_options(project: Path, name: str) -> None:
    put_mesh(project, watertight=False)
    summary = export_project(project, name)
    mesh = read(project / "export" / name, name)
    assert mesh.extents[0] == pytest.approx(2 * RADIUS_UM, rel=0.02)
    np.testing.assert_allclose(summary["size_mm"], mesh.extents, rtol=1e-5)
    np.testing.assert_allclose(mesh.bounds[0], 0.0, atol=1e-6)


@BOTH
@pytest.mark.parametrize("factor", [1.0, 20000.0])
def test_the_scale_factor_is_that_of_the_print(project: Path, name: str, factor: float) -> None:
    put_mesh(project, watertight=False)
    export_project(project, name, options=FormatOptions(scale_factor=factor))
    mesh = read(project / "export" / name, name)
    assert mesh.extents[0] == pytest.approx(2 * RADIUS_UM * 1e-3 * factor, rel=0.02)


@BOTH
def test_a_closed_mesh_is_closed_to_the_reader_and_faces_outside(project: Path, name: str) -> None:
    put_mesh(project, watertight=True)
    summary = export_project(project, name)
    mesh = read(project / "export" / name, name)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # a ball without the cap above half its radius, which a flat lid closes
    height = 0.5 * RADIUS_UM
    cap = np.pi * height**2 * (3 * RADIUS_UM - height) / 3
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS_UM**3 - cap, rel=0.05)
    assert summary["watertight"]
    assert summary["volume_mm3"] == pytest.approx(mesh.volume, rel=1e-4)
    assert summary["notes"] == []


@BOTH
def test_an_open_mesh_is_said_to_be_open(project: Path, name: str, capsys) -> None:
    put_mesh(project, watertight=False)
    assert main(["export", str(project), "--format", name]) == 0
    said = capsys.readouterr().err
    assert "the mesh has holes" in said
    assert " mm" in said
    stated = json.loads((project / "export" / name / "export.json").read_text())
    assert stated["watertight"] is False


def test_3mf_names_its_unit(project: Path) -> None:
    put_mesh(project, watertight=True)
    export_project(project, "3mf")
    with zipfile.ZipFile(project / "export/3mf/mesh.3mf") as file:
        model = next(n for n in file.namelist() if n.endswith(".model"))
        assert b'unit="millimeter"' in file.read(model)


@BOTH
def test_without_a_mesh_it_is_one_sentence(project: Path, name: str) -> None:
    (project / "mesh/mesh.ply").unlink()
    with pytest.raises(InputError, match=r"mesh\.ply is missing: run `semsfm mesh`"):
        export_project(project, name)
    assert not (project / "export" / name).exists()


@BOTH
def test_the_mesh_of_a_colmap_folder_is_printed_in_units_of_its_model(
    name: str, tmp_path: Path, capsys
) -> None:
    write_model(perspective_model(ball(1500), around(12)), tmp_path / "sparse/0")
    mesh_colmap(tmp_path, options=SurfaceOptions(watertight=True))
    assert main(["export", str(tmp_path / "mesh_semsfm"), "--to", name]) == 0
    mesh = read(tmp_path / "mesh_semsfm/export" / name, name)
    assert mesh.is_watertight
    assert mesh.extents[0] == pytest.approx(2 * BALL_RADIUS, rel=0.05)
    assert "counts units of the model" in capsys.readouterr().err


def test_the_mesh_of_a_colmap_folder_goes_to_no_other_format(tmp_path: Path) -> None:
    write_model(perspective_model(ball(1500), around(12)), tmp_path / "sparse/0")
    mesh_colmap(tmp_path)
    with pytest.raises(UsageError, match="exported to stl or 3mf"):
        export_project(tmp_path / "mesh_semsfm", "nvm")
    with pytest.raises(UsageError, match="unknown format"):
        export_project(tmp_path / "mesh_semsfm", "objj")
    (tmp_path / "mesh_semsfm/mesh.json").write_text("{")
    with pytest.raises(InputError, match=r"mesh\.json cannot be read"):
        export_project(tmp_path / "mesh_semsfm", "stl")
