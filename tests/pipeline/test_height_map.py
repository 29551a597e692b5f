"""`semsfm heightmap` on a project folder: what it writes, says and refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.evaluation.truth import Truth
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.io.ply import read_ply_mesh, write_ply, write_ply_file
from semsfm_colmap.metrology.heights.files.registry import read_height_map
from semsfm_colmap.metrology.heights.height_map_options import HeightMapOptions
from semsfm_colmap.metrology.heights.levelling import level
from semsfm_colmap.metrology.heights.scale_limited import TRANSFER_PX
from semsfm_colmap.pipeline.height_map import height_map
from semsfm_colmap.types import TriangleMesh
from tests.exports.ball_project import UNIT, write_project
from tests.metrology.heights.surfaces import a_map, rough, sheet
from tests.surface.scene import RADIUS, SCALE

PX = UNIT / SCALE
"""Micrometres in a px"""
FEW = HeightMapOptions(num_draws=3)
Z = 8.0 * PX * rough(100, 120, 30.0, 1.0, seed=1)


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of a whole ball; not to be changed."""
    return write_project(tmp_path_factory.mktemp("ball") / "p", special=False)


@pytest.fixture(scope="module")
def field(ball: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with a rough field for a mesh, tilted, seen from the side of negative z."""
    path = tmp_path_factory.mktemp("field") / "p"
    shutil.copytree(ball, path)
    flat = sheet(Z, 1.5 * PX, sigma=0.3 * PX)
    turn = rotation_from_vector(np.array([[np.pi - 0.3, 0.0, 0.0]]))[0]
    write_ply(path / "mesh" / "mesh.ply", replace(flat, vertices=flat.vertices @ turn.T))
    return path


@pytest.fixture
def project(field: Path, tmp_path: Path) -> Path:
    return shutil.copytree(field, tmp_path / "p")


def project_centre(path: Path) -> np.ndarray:
    """Where the first image shows the middle of the mesh."""
    mesh = read_ply_mesh(path / "mesh" / "mesh.ply")
    cameras = read_model(path / "sparse" / "0").cameras
    return cameras.project(mesh.vertices.mean(axis=0)[None], np.zeros(1, dtype=int))[0]


def test_the_map_its_picture_and_the_parameters_are_written(project):
    data = height_map(project, FEW, to=["tif", "x3p"])
    assert json.loads((project / "metrology" / "areal.json").read_text()) == data
    assert (project / "metrology" / "height_map.png").read_bytes()[:4] == b"\x89PNG"
    tif, x3p = (read_height_map(project / "metrology" / f"height_map.{f}") for f in ("tif", "x3p"))
    np.testing.assert_allclose(tif.z, x3p.z, rtol=1e-5, atol=1e-7)
    assert tif.unit == data["unit"] == "um"
    levelled = level(a_map(Z, 1.5 * PX, 1.5 * PX)).height_map.z
    assert np.nanstd(x3p.z) == pytest.approx(levelled.std(), rel=0.02)
    assert data["grid"]["spacing"][0] == pytest.approx(1.5 * PX, rel=0.02)
    # x lies along the image, but for what the relief itself tilts its mean plane by
    assert np.array(data["axes"])[0] == pytest.approx([1.0, 0.0, 0.0], abs=0.06)
    Sq = data["parameters"]["Sq"]
    assert Sq["unit"] == "um"
    assert Sq["sources"]["scale"] == pytest.approx(0.03 * Sq["value"])
    low, high = Sq["interval_95"]
    assert low < Sq["value"] < high
    assert not list((project / "metrology").glob(".*"))


def test_the_same_run_gives_the_same_numbers(project):
    assert height_map(project, FEW) == height_map(project, FEW)


def test_the_default_s_filter_is_twice_what_the_reconstruction_has_filtered_off(project):
    data = height_map(project, FEW)
    assert data["transfer"]["nesting_index"] == pytest.approx(TRANSFER_PX * PX, rel=1e-2)
    assert data["filtering"]["s_index"] == pytest.approx(2.0 * TRANSFER_PX * PX, rel=1e-2)


def test_an_s_filter_below_what_was_averaged_away_is_refused(project):
    with pytest.raises(InputError, match="averaged away"):
        height_map(project, replace(FEW, s_filter=10.0 * PX))


def test_characteristics_that_nobody_measured_are_not_assessed(project):
    data = height_map(project, FEW)
    assert {c["symbol"]: c["value"] for c in data["characteristics"]} == dict.fromkeys(
        ["N_M", "z_FLT", "alpha_z", "l_z", "D_LIM", "FRC 1/2"]
    )
    assert data["parameters"]["Sq"]["sources"]["amplification"] == "not assessed"


def test_a_line_drawn_in_an_image_has_profile_parameters(project):
    centre = project_centre(project)
    x, y = centre
    data = height_map(project, FEW, profile=(x - 60.0, y, x + 60.0, y))
    (x0, y0), (x1, y1) = data["profile"]["ends"]
    # x of the map lies along the image
    assert x1 - x0 == pytest.approx(120.0 * PX, rel=0.05)
    assert abs(y1 - y0) < 10.0 * PX
    Pq = data["profile"]["parameters"]["Pq"]
    assert Pq["unit"] == "um"
    assert 0.0 < Pq["value"] < 3.0 * Z.std()
    assert Pq["standard_uncertainty"] >= 0.03 * Pq["value"]
    with pytest.raises(InputError, match="no cell at"):
        height_map(project, FEW, profile=(-500.0, y, x, y))


def test_known_steps_tell_the_amplification(project):
    assert main([
        "heightmap", str(project), "--num_draws", "2", "-q",
        "--steps", "0", "0", "1", "0.98", "2", "1.96",
    ]) == 0  # fmt: skip
    data = json.loads((project / "metrology" / "areal.json").read_text())
    found = {c["symbol"]: c["value"] for c in data["characteristics"]}
    assert found["alpha_z"] == pytest.approx(0.98)


def test_a_truth_of_other_images_is_refused(project, tmp_path):
    from semsfm_colmap.synthetic.options import SynthesizeOptions
    from semsfm_colmap.synthetic.series import synthesize

    synthesize(
        tmp_path / "s",
        SynthesizeOptions(
            scene="field", num_images=3, width_px=64, height_px=64, databar=False, mesh_edge_px=8.0
        ),
    )
    with pytest.raises(InputError, match="not the truth of these images"):
        height_map(project, FEW, truth_path=tmp_path / "s")


def test_what_stands_over_the_truth_beside_the_region_is_left_out(field, tmp_path, monkeypatch):
    """The truth is the mesh itself and a roof over the region that the image shows beside it."""
    copy = shutil.copytree(field, tmp_path / "p")
    model = read_model(copy / "sparse" / "0")
    mesh = read_ply_mesh(copy / "mesh" / "mesh.ply")
    x, y = project_centre(copy)
    region = (x - 35.0, y - 35.0, x + 35.0, y + 35.0)
    up = np.array(height_map(copy, FEW, region=region)["axes"])[2]
    shown = model.cameras.project(mesh.vertices, np.zeros(len(mesh.vertices), dtype=int))
    below = np.all(np.abs(shown - [x, y]) < 35.0, axis=1)
    # the map looks down along `up`, the image 17 degrees from it: 74 px to the side
    roof = mesh.vertices + 250.0 * PX * up
    faces = mesh.faces[below[mesh.faces].all(axis=1)]
    true = Truth(
        path=copy,
        names=model.image_names,
        cameras=model.cameras,
        image_size_px=(160, 120),
        unit_um=1.0,
        true_deg=np.zeros(model.num_images),
        axis=np.array([0.0, 1.0, 0.0]),
        mesh=mesh,
    )
    roofed = TriangleMesh(
        vertices=np.concatenate([mesh.vertices, roof]),
        faces=np.concatenate([mesh.faces, faces + len(mesh.vertices)]),
    )
    found = []
    for truth in (true, replace(true, mesh=roofed)):
        monkeypatch.setattr("semsfm_colmap.evaluation.truth.load_truth", lambda path, t=truth: t)
        found.append(height_map(copy, FEW, region=region, truth_path=copy)["characteristics"])
    assert found[0] == found[1]
    values = {c["symbol"]: c["value"] for c in found[0]}
    assert values["alpha_z"] == pytest.approx(1.0, abs=0.1)


def test_halves_of_the_frames_tell_the_noise(project):
    rng = np.random.default_rng(1)
    mesh = read_ply_mesh(project / "mesh" / "mesh.ply")
    names = ("x", "y", "z", "nx", "ny", "nz", "difference")
    rows = np.empty(len(mesh.vertices), dtype=[(n, "<f4") for n in names])
    up = np.array(height_map(project, FEW)["axes"])[2]
    for k in range(3):
        rows[names[k]], rows[names[3 + k]] = mesh.vertices[:, k], up[k]
    rows["difference"] = 2.0 * PX * rng.normal(size=len(rows))
    write_ply_file(project / "dense" / "half_series.ply", rows, comment="test")
    found = {c["symbol"]: c for c in height_map(project, FEW)["characteristics"]}
    # white noise behind the S-filter, of 2 T on cells of 1.5 px
    from semsfm_colmap.metrology.heights.parameter_uncertainty import unit_gain

    expected = 2.0 * PX * unit_gain(2.0 * TRANSFER_PX, 1.5) ** 2 / np.sqrt(2.0)
    assert found["N_M"]["value"] == pytest.approx(expected, rel=0.25)
    assert found["FRC 1/2"]["value"] > 0.0


def test_a_whole_ball_is_refused_and_a_region_of_it_has_a_height_map(ball, tmp_path):
    copy = shutil.copytree(ball, tmp_path / "b")
    with pytest.raises(InputError, match=r"closed or overhanging.*--region"):
        height_map(copy, FEW)
    options = replace(FEW, level="sphere", spacing=1.5 * PX, s_filter=24.0 * PX)
    data = height_map(copy, options, region=(55.0, 35.0, 105.0, 85.0))
    assert data["parameters"]["Sq"]["value"] < 0.02 * RADIUS * UNIT
    with pytest.raises(InputError, match="shows nothing"):
        height_map(copy, options, region=(0.0, 0.0, 5.0, 5.0))
    with pytest.raises(UsageError, match="is empty"):
        height_map(copy, options, region=(50.0, 0.0, 5.0, 5.0))
    with pytest.raises(InputError, match=r"no image is called none\.png"):
        height_map(copy, options, region=(0.0, 0.0, 5.0, 5.0), region_image="none.png")


def test_without_a_mesh_it_says_how_to_make_one(project):
    (project / "mesh" / "mesh.ply").unlink()
    with pytest.raises(InputError, match="semsfm mesh"):
        height_map(project)


def test_a_model_in_px_is_never_written_in_metres(project):
    sidecar = project / "sparse" / "0" / "orthographic.json"
    said = json.loads(sidecar.read_text())
    said |= {"world_unit": "px", "pixel_size": None}
    sidecar.write_text(json.dumps(said))
    data = height_map(project, FEW, to=["tif"])
    assert data["unit"] == data["parameters"]["Sq"]["unit"] == "px"
    assert any("no pixel size" in note for note in data["notes"])
    with pytest.raises(InputError, match="no pixel size is known"):
        height_map(project, FEW, to=["x3p"])


def test_the_command_says_the_parameters_with_their_uncertainties(project, capsys):
    assert main(["heightmap", str(project), "--num_draws", "3", "--to", "gsf,xyz"]) == 0
    text = "".join(capsys.readouterr())
    assert "height map: 1" in text
    assert "Sq 0.0" in text
    assert "+-" in text
    assert (project / "metrology" / "height_map.xyz").is_file()


def test_an_unknown_format_is_refused_before_anything_is_computed(project, capsys):
    assert main(["heightmap", str(project), "--to", "sur"]) == 2
    assert "x3p, sdf" in capsys.readouterr().err
    assert not (project / "metrology").exists()
