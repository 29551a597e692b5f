"""What was damaged is made again and said; what a person changed keeps a way into the project."""

import json
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.file import read_series
from semsfm_colmap.io.ply import read_ply_cloud, write_ply
from semsfm_colmap.pipeline.export import export_project
from semsfm_colmap.pipeline.foreign.import_database import reconstruct_from_database
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.runner import reconstruct, run_stages
from tests.ingest.images import pixels_of, save, texture
from tests.pipeline.test_runner import Spy

NAMES = ("a.png", "b.png", "c.png")
ALL = ("ingest", "extract", "match", "map", "densify", "mesh", "report")


class Ear(Reporter):
    """Keeps the warnings."""

    def __init__(self):
        super().__init__(-1)
        self.heard = []

    def warn(self, line):
        self.heard.append(line)


def damage(path, way):
    content = path.read_bytes()
    if way == "deleted":
        path.unlink()
    elif way == "emptied":
        path.write_bytes(b"")
    elif way == "cut":
        path.write_bytes(content[: len(content) // 2])
    else:
        middle = len(content) // 2
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Three images with a mask each, and what the first stage makes of them."""
    base = tmp_path_factory.mktemp("prepared")
    mask = np.full((160, 200), 255, dtype=np.uint8)
    mask[:, :30] = 0
    for k, name in enumerate(NAMES):
        save(base / "images" / name, texture(k))
        save(base / "masks" / f"{name}.png", mask)
    run_stages(base / "p", Config(), names=("ingest",), image_path=base / "images")
    return base


@pytest.mark.parametrize("way", ["deleted", "emptied", "cut", "another byte"])
@pytest.mark.parametrize("name", ["series.json", "images/b.png", "masks/c.png.png"])
def test_a_damaged_output_is_made_again_to_the_bit_and_said(prepared, tmp_path, name, way):
    shutil.copytree(prepared / "p", tmp_path / "p")
    damage(tmp_path / "p" / name, way)
    ear = Ear()
    run_stages(
        tmp_path / "p",
        Config(),
        names=("ingest",),
        image_path=prepared / "images",
        reporter=ear,
    )
    assert (tmp_path / "p" / name).read_bytes() == (prepared / "p" / name).read_bytes()
    said = [line for line in ear.heard if line.startswith("ingest: ")]
    assert len(said) == 1
    assert said[0].startswith(f"ingest: {name} is ")
    assert said[0].endswith(": made again")


def test_masks_changed_by_hand_are_kept_where_the_command_that_is_said_finds_them(
    prepared, tmp_path
):
    project, ear = tmp_path / "p", Ear()
    shutil.copytree(prepared / "p", project)
    mask = np.full((160, 200), 255, dtype=np.uint8)
    mask[:, :80] = 0
    save(project / "masks" / "b.png.png", mask)
    ask = {"names": ("ingest",), "image_path": prepared / "images", "reporter": ear}
    run_stages(project, Config(), **ask)
    kept = project / "changed" / "masks"
    assert f"the changed masks are kept in {kept}: `--masks_path {kept}` takes them" in ear.heard
    assert (pixels_of(project / "masks" / "b.png.png") != mask).any()
    run_stages(project, Config(ingest=IngestOptions(masks_path=kept)), **ask)
    assert (pixels_of(project / "masks" / "b.png.png") == mask).all()
    assert (project / "masks" / "a.png.png").is_file()


def test_every_file_of_a_project_has_a_fingerprint(small_project):
    stages = json.loads((small_project / "run.json").read_text())["stages"]
    known = {name.split("#")[0] for stage in stages.values() for name in stage["outputs"]}
    there = {p.relative_to(small_project).as_posix() for p in small_project.rglob("*")}
    files = {name for name in there if (small_project / name).is_file()}
    assert files - known == {"run.json", "semsfm.toml", "semsfm.log", ".semsfm.lock"}
    assert known <= files


@pytest.fixture
def project(small_project, tmp_path):
    return shutil.copytree(small_project, tmp_path / "p")


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("database.db", "extract"),
        ("sparse/0/cameras.bin", "map"),
        ("sparse/0/points.ply", "map"),
        ("dense/fused.ply", "densify"),
        ("mesh/mesh.glb", "mesh"),
        ("report/report.html", "report"),
    ],
)
@pytest.mark.parametrize("way", ["deleted", "emptied", "cut"])
def test_no_stage_is_up_to_date_with_a_damaged_output(
    project, small_series, monkeypatch, name, stage, way
):
    damage(project / name, way)
    spy, ear = Spy(monkeypatch, pretend=ALL), Ear()
    reconstruct(small_series / "images", project, Config(), reporter=ear)
    assert spy.ran == (["extract", "match", "map"] if stage == "extract" else [stage])
    assert len(ear.heard) == 1
    assert ear.heard[0].startswith(f"{stage}: {name} is ")


def test_a_part_of_the_database_that_was_changed_is_made_again_and_kept(
    project, small_series, monkeypatch
):
    import sqlite3
    from contextlib import closing

    with closing(sqlite3.connect(project / "database.db")) as db, db:
        db.execute("DELETE FROM matches WHERE pair_id = (SELECT min(pair_id) FROM matches)")
    before = (project / "database.db").read_bytes()
    spy, ear = Spy(monkeypatch, pretend=ALL), Ear()
    reconstruct(small_series / "images", project, Config(), reporter=ear)
    assert spy.ran == ["match"]
    assert (project / "changed" / "database.db").read_bytes() == before
    assert "--database_path" in ear.heard[1]


@pytest.mark.slow
def test_a_damaged_database_ends_in_the_same_model(project, small_project, small_series):
    model = "sparse/0/points3D.bin"
    damage(project / "database.db", "cut")
    ear = Ear()
    reconstruct(small_series / "images", project, Config(), reporter=ear)
    assert (project / model).read_bytes() == (small_project / model).read_bytes()
    assert ear.heard == ["extract: database.db is missing or damaged: made again"]


def test_a_model_edited_in_place_is_made_again_and_kept_for_adopt(
    project, small_series, monkeypatch
):
    from semsfm_colmap.colmap.library import pycolmap

    folder = project / "sparse" / "0"
    model = pycolmap.Reconstruction(str(folder))
    model.delete_point3D(min(model.points3D))
    model.write_binary(str(folder))
    edited = (folder / "points3D.bin").read_bytes()
    Spy(monkeypatch, pretend=ALL)
    ear = Ear()
    reconstruct(small_series / "images", project, Config(), reporter=ear)
    kept = project / "changed" / "sparse" / "0"
    assert (kept / "points3D.bin").read_bytes() == edited
    assert f"`semsfm adopt {project} --model_path {kept}` takes it over" in ear.heard[1]
    monkeypatch.undo()
    assert main(["adopt", str(project), "--model_path", str(kept)]) == 0
    assert len(read_model(folder).points) == len(model.points3D)
    # what was adopted is the project's model from here on
    spy, ear = Spy(monkeypatch, pretend=ALL), Ear()
    reconstruct(small_series / "images", project, Config(), reporter=ear)
    assert spy.ran == ["densify", "mesh", "report"]
    assert not [line for line in ear.heard if line.startswith("map: sparse/0/points3D.bin is")]


def test_a_stage_on_its_own_takes_what_a_person_changed_and_says_so(project, monkeypatch):
    path = project / "dense" / "fused.ply"
    cloud = read_ply_cloud(path)
    write_ply(path, replace(cloud, points=cloud.points + 1.0))
    changed = path.read_bytes()
    spy, ear = Spy(monkeypatch, pretend=("mesh", "report")), Ear()
    for ran in (["mesh"], ["mesh"]):
        run_stages(project, Config(), names=("mesh",), reporter=ear)
        assert spy.ran == ran  # once: the second time nothing has changed since
    assert path.read_bytes() == changed
    assert ear.heard[0] == (
        "densify: dense/fused.ply is not as the last run left it, and used so: "
        f"`semsfm densify {project}` makes them as they were"
    )


@pytest.mark.parametrize("way", ["deleted", "emptied"])
def test_a_stage_on_its_own_names_the_command_that_makes_what_it_needs(
    project, small_series, tmp_path, way
):
    damage(project / "images" / "grain_002.tif", way)
    with pytest.raises(InputError) as refused:
        run_stages(project, Config(), names=("map",))
    images = small_series / "images"
    assert str(refused.value) == (
        f"{project}: images/grain_002.tif is missing or damaged: run `semsfm extract {images} "
        f"--output_path {project}` first"
    )
    assert main(["extract", str(images), "--output_path", str(project), "-q"]) == 0
    run_stages(project, Config(), names=("map",))


@pytest.mark.parametrize("content", ["", "{", "{}", '{"format": "semsfm-series", "version": 1}'])
def test_what_a_damaged_series_says_to_type_makes_it_again(prepared, tmp_path, content):
    project = shutil.copytree(prepared / "p", tmp_path / "my project")
    (project / "series.json").write_text(content)
    with pytest.raises(InputError, match="semsfm extract IMAGES --output_path") as refused:
        read_series(project / "series.json")
    command = shlex.split(str(refused.value).split("`")[1])
    assert command[0] == "semsfm"
    images = str(prepared / "images")
    # the images are not enough of a series for more than to be prepared
    main([images if word == "IMAGES" else word for word in command[1:]])
    series = read_series(project / "series.json")
    assert series.names == NAMES


@pytest.mark.parametrize("way", ["deleted", "emptied"])
def test_an_export_does_not_leave_out_a_depth_map_that_has_gone(project, way):
    path = project / "dense" / "depth_maps" / "grain_003.tif.npz"
    damage(path, way)
    with pytest.raises(InputError) as refused:
        export_project(project, "colmap-dense")
    assert str(refused.value) == f"{path} is missing or empty: run `semsfm densify {project}` first"
    assert not any((project / "export").iterdir())
    export_project(project, "nvm")


def test_a_database_that_is_imported_into_a_project_is_no_damage_to_it(
    project, small_series, tmp_path, monkeypatch
):
    other = shutil.copy(project / "database.db", tmp_path / "other.db")
    spy, ear = Spy(monkeypatch, pretend=ALL), Ear()
    reconstruct_from_database(small_series / "images", other, project, Config(), reporter=ear)
    assert spy.ran[0] == "map"
    assert ear.heard == []
    assert not (project / "changed").exists()
