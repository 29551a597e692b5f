"""Projects of other versions of the program: those of older ones go on, newer ones are refused.

The old project was made by the first code that wrote run.json, of six rendered images.
"""

from __future__ import annotations

import json
import shutil
import tarfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from semsfm_colmap.cli.commands import COMMANDS
from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.series.file import read_preparation, read_series
from semsfm_colmap.pipeline.foreign.mesh_colmap import read_record
from semsfm_colmap.pipeline.goniometer import read_goniometer
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.segmentation.files import read_table

ARCHIVE = Path(__file__).parent / "projects" / "project_0_1_0.tar.xz"

READING = {
    "segment": ("PROJECT",),
    "measure": ("PROJECT", "--points", "grain_002.png:53,56", "grain_002.png:49,60"),
    "goniometer": ("PROJECT",),
    "heightmap": ("PROJECT", "--spacing", "0.2"),
    "export": ("PROJECT", "--to", "ply"),
    "adopt": ("PROJECT", "--model_path", "PROJECT/sparse/1", "--dry_run"),
    "evaluate": ("PROJECT", "TRUTH"),
}
"""Arguments of the commands that take a project's model as it is."""
MAKING = {
    "plan": ("--project", "PROJECT"),
    "reconstruct": ("IMAGES", "--output_path", "PROJECT", "--force"),
    "extract": ("IMAGES", "--output_path", "PROJECT", "--force"),
    "match": ("PROJECT",),
    "map": ("PROJECT",),
    "densify": ("PROJECT",),
    "mesh": ("PROJECT",),
    "report": ("PROJECT",),
    "merge": ("PROJECT", "COPY", "--output_path", "MERGED"),
}
"""Those of the commands that make a part of it again, or take long."""
COMPARE = {"compare": ("PROJECT", "COPY", "--output_path", "COMPARED")}
VIEW = {"view": ("PROJECT", "--no-browser")}
WITHOUT_PROJECT = {
    "inspect",
    "compare-features",
    "synthesize",
    "example",
    "doctor",
    "completion",
}


@pytest.fixture
def places(tmp_path: Path) -> Mapping[str, Path]:
    """The old project, a copy of it, its images and their truth; where results may go."""
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(tmp_path, filter="data")
    project = tmp_path / "project"
    return {
        "PROJECT": project,
        "COPY": Path(shutil.copytree(project, tmp_path / "copy")),
        "IMAGES": Path(shutil.copytree(project / "images", tmp_path / "images")),
        "TRUTH": tmp_path / "truth.json",
        "COMPARED": tmp_path / "compared",
        "MERGED": tmp_path / "merged",
    }


def filled(arguments: tuple[str, ...], places: Mapping[str, Path]) -> list[str]:
    """The arguments with the paths that their words stand for."""
    heads = (argument.partition("/") for argument in arguments)
    return [f"{places.get(head, head)}{slash}{rest}" for head, slash, rest in heads]


def set_version(file: Path, version: object) -> None:
    file.write_text(json.dumps({**json.loads(file.read_text()), "version": version}))


def test_every_command_that_opens_a_project_is_tried_here():
    known = {*READING, *MAKING, *COMPARE, *VIEW, *WITHOUT_PROJECT}
    assert {command.name for command in COMMANDS} <= known


@pytest.mark.parametrize("name", READING)
def test_a_project_of_the_first_version_is_read_by(name, places, capsys):
    assert main([name, *filled(READING[name], places)]) == 0, capsys.readouterr().err


def test_meshes_of_the_first_version_have_no_error_bars_and_compare_says_what_makes_them(
    places, capsys
):
    assert main(["compare", *filled(COMPARE["compare"], places)]) == 1
    assert "no error bars: make it anew with `semsfm mesh`" in capsys.readouterr().err


def test_a_project_of_the_first_version_is_shown_by_the_viewer(places):
    from semsfm_colmap.pipeline.view import make_server

    server = make_server(places["PROJECT"])
    try:
        assert server.content.scene().packed
    finally:
        server.server_close()


# what reconstruct does is what the others do; its small images are too few for today's keypoints
@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in MAKING if name != "reconstruct"])
def test_a_project_of_the_first_version_goes_on_with(name, places, capsys):
    assert main([name, *filled(MAKING[name], places)]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("name", [*READING, *MAKING, *COMPARE, *VIEW])
def test_a_project_of_version_99_is_refused_in_one_sentence_by(name, places, capsys):
    set_version(places["PROJECT"] / "run.json", 99)
    before = sorted(places["PROJECT"].rglob("*"))
    arguments = {**READING, **MAKING, **COMPARE, **VIEW}[name]
    assert main([name, *filled(arguments, places)]) == 1
    said = [line for line in capsys.readouterr().err.splitlines() if line]
    assert len(said) == 1
    assert f"{places['PROJECT'] / 'run.json'} was written by a newer semsfm" in said[0]
    assert sorted(places["PROJECT"].rglob("*")) == before


def test_no_project_is_merged_into_one_of_version_99(places, capsys):
    merged = places["MERGED"]
    shutil.copytree(places["PROJECT"], merged)
    set_version(merged / "run.json", 99)
    assert main(["merge", *filled(MAKING["merge"], places), "--force"]) == 1
    assert f"{merged / 'run.json'} was written by a newer semsfm" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["export", "goniometer", "segment", "plan", "measure", "report"])
def test_a_model_of_version_99_is_refused_by(name, places, capsys):
    set_version(places["PROJECT"] / "sparse" / "0" / "orthographic.json", 99)
    assert main([name, *filled({**READING, **MAKING}[name], places)]) == 1
    assert "orthographic.json was written by a newer semsfm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("series.json", lambda project: read_series(project.series)),
        ("series.json", lambda project: read_preparation(project.series)),
        ("segments/segments.json", lambda project: read_table(project.segments)),
        ("report/goniometer.json", read_goniometer),
        ("mesh.json", lambda project: read_record(project.path)),
    ],
)
def test_a_file_of_version_99_is_refused(name, read, places):
    file = places["PROJECT"] / name
    file.parent.mkdir(exist_ok=True)
    if not file.is_file():
        file.write_text("{}")
    set_version(file, 99)
    with pytest.raises(InputError, match=f"{file.name} was written by a newer semsfm"):
        read(Project(places["PROJECT"]))
