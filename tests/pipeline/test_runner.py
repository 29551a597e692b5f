import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config, read_config
from semsfm_colmap.errors import InputError, MissingDependencyError, UsageError
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.pipeline import runner
from semsfm_colmap.pipeline.runner import STAGE_NAMES, reconstruct, run_stages
from semsfm_colmap.pipeline.sources import input_hashes
from semsfm_colmap.records import StageRecord
from tests.ingest.stacks import textures, write_stack

FILES = (
    "semsfm.toml",
    "database.db",
    "series.json",
    "run.json",
    "semsfm.log",
    "sparse/0/cameras.bin",
    "sparse/0/images.bin",
    "sparse/0/points3D.bin",
    "sparse/0/rigs.bin",
    "sparse/0/frames.bin",
    "sparse/0/orthographic.json",
    "dense/fused.ply",
    "mesh/mesh.ply",
    "mesh/mesh.glb",
    "mesh/mesh.obj",
    "mesh/shading.json",
    "report/report.html",
    "report/metrics.json",
)


class Spy:
    """Counts which stages really ran; those to `pretend` leave everything as it is."""

    def __init__(self, monkeypatch, pretend=()):
        self.ran = []
        self.pretend = pretend
        for stage in runner.STAGES:
            replace_run(monkeypatch, stage.name, self.wrap(stage))

    def wrap(self, stage):
        def run(on):
            self.ran.append(stage.name)
            return StageRecord() if stage.name in self.pretend else stage.run(on)

        return run


def replace_run(monkeypatch, name, run):
    """Let a stage run another function."""
    stages = [replace(s, run=run) if s.name == name else s for s in runner.STAGES]
    monkeypatch.setattr(runner, "STAGES", tuple(stages))


@pytest.fixture
def project(small_project, tmp_path):
    shutil.copytree(small_project, tmp_path / "p")
    return tmp_path / "p"


def test_every_file_of_the_layout_is_there(small_project):
    missing = [name for name in FILES if not (small_project / name).is_file()]
    assert missing == []
    assert len(list((small_project / "images").iterdir())) == 7
    assert not [p.name for p in small_project.rglob("*") if p.name.endswith((".part", ".old"))]


def test_the_reconstruction_is_right_in_micrometres(small_project, small_series):
    model = read_model(small_project / "sparse" / "0")
    assert model.num_images == 7
    assert model.world_unit == "um"
    figures = evaluate(model, load_truth(small_series))
    assert figures["rotation_error_median_deg"] < 0.6
    truth = load_truth(small_series)
    assert np.allclose(model.cameras.scale_px_per_unit, 1.0 / model.pixel_size_um, rtol=0.003)
    assert model.pixel_size_um == pytest.approx(truth.pixel_size_um, rel=1e-3)


def test_colmap_opens_the_model_and_the_database(small_project):
    model = pycolmap.Reconstruction(str(small_project / "sparse" / "0"))
    assert model.num_reg_images() == 7
    with pycolmap.Database.open(str(small_project / "database.db")) as db:
        assert db.num_images() == 7
        assert db.num_verified_image_pairs() > 6


def test_a_second_run_does_nothing_and_changes_nothing(project, small_series, monkeypatch):
    before = {p: p.read_bytes() for p in project.rglob("*.bin")}
    spy = Spy(monkeypatch)
    reconstruct(small_series / "images", project, Config())
    assert spy.ran == []
    assert all(path.read_bytes() == content for path, content in before.items())


def test_a_changed_option_reruns_its_stage_and_those_after_it(project, small_series, monkeypatch):
    spy = Spy(monkeypatch, pretend=("map", "densify", "mesh", "report"))
    config = Config()
    config = replace(config, refinement=replace(config.refinement, scale_sigma=0.002))
    reconstruct(small_series / "images", project, config)
    assert spy.ran == ["map", "densify", "mesh", "report"]
    assert read_config(project / "semsfm.toml") == config


@pytest.mark.parametrize(
    ("name", "anew"),
    [
        ("pixel_size_um", ["ingest", "map", "report"]),
        ("series_csv", ["ingest", "map", "report"]),
        ("denoise", ["ingest", "extract", "match", "map", "report"]),
    ],
)
def test_only_other_pixels_ask_for_features_anew(
    project, small_series, tmp_path, monkeypatch, name, anew
):
    table = tmp_path / "series.csv"
    names = sorted(path.name for path in (small_series / "images").iterdir())
    table.write_text("image,tilt_deg\n" + "".join(f"{n},{3 * k}\n" for k, n in enumerate(names)))
    spy = Spy(monkeypatch, pretend=("extract", "match", "map", "report"))
    config = Config()
    value = {"pixel_size_um": 0.5, "series_csv": table, "denoise": "median"}[name]
    config = replace(config, ingest=replace(config.ingest, **{name: value}))
    run = ("ingest", "extract", "match", "map", "report")
    for again in (anew, []):
        spy.ran.clear()
        run_stages(project, config, names=run, image_path=small_series / "images")
        assert spy.ran == again


def test_a_report_is_out_of_date_when_the_model_or_the_mesh_is_another(
    project, small_series, monkeypatch
):
    spy = Spy(monkeypatch, pretend=("map", "report"))
    run_stages(project, Config(), names=("report",))
    assert spy.ran == []
    config = replace(Config(), refinement=replace(Config().refinement, scale_sigma=0.002))
    run_stages(project, config, names=("map",))
    run_stages(project, config, names=("report",))
    assert spy.ran == ["map", "report"]
    # the mesh is still that of the other model, and nothing else has changed
    run_stages(project, config, names=("report",))
    assert spy.ran == ["map", "report"]
    record = json.loads((project / "run.json").read_text())
    del record["stages"]["mesh"]
    (project / "run.json").write_text(json.dumps(record))
    run_stages(project, config, names=("report",))
    assert spy.ran == ["map", "report", "report"]


def test_a_run_that_was_cut_off_goes_on_and_ends_with_the_same_model_to_the_bit(
    project, small_series, tmp_path, monkeypatch
):
    images, target = small_series / "images", tmp_path / "cut"
    names = ("ingest", "extract", "match", "map")

    def cut(on):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        replace_run(patched, "match", cut)
        with pytest.raises(KeyboardInterrupt):
            run_stages(target, Config(), names=names, image_path=images)
    assert json.loads((target / "run.json").read_text())["stages"]["match"]["status"] == "running"
    spy = Spy(monkeypatch)
    run_stages(target, Config(), names=names, image_path=images)
    assert spy.ran == ["match", "map"]
    for name in ("points3D.bin", "images.bin", "orthographic.json"):
        first, second = (p / "sparse" / "0" / name for p in (project, target))
        assert first.read_bytes() == second.read_bytes()


def test_run_json_says_what_ran_on_what(small_project, small_series):
    record = json.loads((small_project / "run.json").read_text())
    assert list(record["stages"]) == list(STAGE_NAMES)
    assert all(stage["status"] == "done" for stage in record["stages"].values())
    assert all(stage["seconds"] >= 0 for stage in record["stages"].values())
    assert len(record["inputs"]) == 7
    assert {"semsfm_colmap", "pycolmap", "numpy"} <= set(record["versions"])


def test_a_folder_of_another_program_is_left_alone(small_series, tmp_path):
    (tmp_path / "database.db").write_text("somebody's")
    with pytest.raises(UsageError, match="not made by semsfm"):
        reconstruct(small_series / "images", tmp_path)
    assert (tmp_path / "database.db").read_text() == "somebody's"
    assert [p.name for p in tmp_path.iterdir()] == ["database.db"]


def test_a_second_process_on_the_same_project_is_told_so(project, small_series):
    from semsfm_colmap.pipeline.project import Project, locked

    with locked(Project(project)), pytest.raises(UsageError, match="in use by another"):
        reconstruct(small_series / "images", project)


def test_a_stage_without_the_one_before_says_which_to_run(tmp_path, small_series):
    run_stages(tmp_path / "p", Config(), names=("ingest",), image_path=small_series / "images")
    with pytest.raises(Exception, match="semsfm extract"):
        run_stages(tmp_path / "p", Config(), names=("map",))


def test_names_with_spaces_and_unicode_work(small_series, tmp_path):
    images = tmp_path / "my images"
    images.mkdir()
    for k, path in enumerate(sorted((small_series / "images").iterdir())):
        shutil.copy(path, images / f"grän {k}.tif")
    project = tmp_path / "my project"
    run_stages(project, Config(), names=("ingest", "extract", "match", "map"), image_path=images)
    model = read_model(project / "sparse" / "0")
    assert model.image_names == tuple(f"grän {k}.tif" for k in range(7))


def test_a_run_on_a_stack_depends_on_it_and_on_its_angles_alone(tmp_path):
    stack = write_stack(tmp_path / "a.st", textures())
    (tmp_path / "b.rawtlt").write_text("1\n", encoding="utf-8")
    alone = input_hashes(stack, {})
    assert list(alone) == ["a.st"]
    (tmp_path / "a.rawtlt").write_text("1\n", encoding="utf-8")
    with_angles = input_hashes(stack, alone)
    assert list(with_angles) == ["a.st", "a.rawtlt"]
    assert with_angles["a.st"] == alone["a.st"]


def refuse(on):
    raise InputError("the depth maps agree nowhere")


def test_nothing_is_made_of_what_a_stage_that_failed_has_left_before(
    project, small_series, monkeypatch, capsys
):
    spy = Spy(monkeypatch, pretend=STAGE_NAMES)
    replace_run(monkeypatch, "densify", refuse)
    config = replace(Config(), surface=replace(Config().surface, num_normal_neighbors=30))
    reconstruct(small_series / "images", project, config)
    assert spy.ran == ["report"]
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "warning: densify: the depth maps agree nowhere",
        "warning: mesh: not made, because densify came to nothing",
    ]
    stages = json.loads((project / "run.json").read_text())["stages"]
    assert [stages[name]["status"] for name in ("densify", "mesh", "report")] == [
        "failed", "failed", "done",
    ]  # fmt: skip


@pytest.mark.parametrize("names", [("densify",), ("densify", "mesh")])
def test_a_stage_that_was_asked_for_and_fails_is_an_error(project, monkeypatch, names):
    Spy(monkeypatch, pretend=STAGE_NAMES)
    replace_run(monkeypatch, names[-1], refuse)
    with pytest.raises(InputError, match="agree nowhere"):
        run_stages(project, Config(), names=names, force=True)


def test_a_library_that_does_not_load_is_named_before_the_first_stage(
    project, small_series, monkeypatch, capsys
):
    def missing():
        raise MissingDependencyError("open3d is installed but does not load (libGL.so.1)")

    order = []

    def first(on):
        order.append(capsys.readouterr().err)
        raise InputError("far enough")

    monkeypatch.setattr("semsfm_colmap.io.open3d_library.import_open3d", missing)
    Spy(monkeypatch, pretend=STAGE_NAMES)
    replace_run(monkeypatch, "ingest", first)
    with pytest.raises(InputError, match="far enough"):
        run_stages(
            project, Config(), names=STAGE_NAMES, image_path=small_series / "images", force=True
        )
    assert order == [
        "warning: mesh will come to nothing, all else is made: open3d is installed but does not "
        "load (libGL.so.1)\n"
    ]
