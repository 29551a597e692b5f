"""A project keeps the options that it was made with, whatever becomes of semsfm.toml."""

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.config import Config, read_config, write_config
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.project_options import read_project_options
from semsfm_colmap.pipeline.runner import run_stages
from tests.ingest.images import save, texture
from tests.pipeline.test_outputs import Ear

MINE = Config(
    seed=4,
    ingest=IngestOptions(pixel_size_um=0.25),
    matching=MatchingOptions(max_error_px=1.25),
)


@pytest.fixture
def images(tmp_path):
    for k in range(3):
        save(tmp_path / "images" / f"{k}.png", texture(k))
    return tmp_path / "images"


@pytest.fixture
def project(images, tmp_path):
    run_stages(tmp_path / "p", MINE, names=("ingest",), image_path=images)
    return Project(tmp_path / "p")


@pytest.fixture
def asked(monkeypatch):
    """The configurations that runs were started with."""
    configs = []

    def run(path, config, **_):
        configs.append(config)

    monkeypatch.setattr("semsfm_colmap.pipeline.runner.run_stages", run)
    monkeypatch.setattr("semsfm_colmap.pipeline.summary.say_summary", lambda *_: None)
    return configs


@pytest.mark.parametrize("command", ["extract", "reconstruct"])
def test_a_second_run_keeps_what_the_project_was_made_with(command, images, project, asked, capsys):
    run = [command, str(images), "--output_path", str(project.path)]
    assert main(run) == 0
    assert main([*run, "--matching.max_error_px", "2"]) == 0
    assert main([*run, "--quality", "low"]) == 0
    assert asked[0] == MINE
    assert (asked[1].seed, asked[1].matching.max_error_px) == (4, 2.0)
    assert (asked[2].quality, asked[2].ingest.pixel_size_um) == ("low", 0.25)
    assert asked[2].features != MINE.features
    said = capsys.readouterr().err.splitlines()[0]
    assert said == (
        f"options kept from {project.config}: ingest.pixel_size_um = 0.25, "
        "matching.max_error_px = 1.25, seed = 4"
    )


def test_a_file_of_options_stands_in_their_place(images, project, asked, tmp_path):
    write_config(Config(seed=7), tmp_path / "o.toml")
    run = ["extract", str(images), "--output_path", str(project.path)]
    assert main([*run, "--config_path", str(tmp_path / "o.toml")]) == 0
    assert asked == [Config(seed=7)]


@pytest.mark.parametrize("damage", ["deleted", "emptied", "cut in a word", "cut after a line"])
def test_a_damaged_file_is_said_and_made_again_from_run_json(project, images, damage):
    text = project.config.read_text()
    half = text[: text.index("[matching]")]
    left = {"emptied": "", "cut in a word": half + "[match", "cut after a line": half}
    if damage == "deleted":
        project.config.unlink()
    else:
        project.config.write_text(left[damage])
    ear = Ear()
    config = read_project_options(project, reporter=ear)
    assert config == MINE
    assert ear.heard == [
        f"{project.config} is missing or damaged: the options of the last run are taken from "
        "run.json"
    ]
    run_stages(project.path, config, names=("ingest",), image_path=images)
    assert project.config.read_text() == text


def test_what_a_person_writes_into_the_file_counts(project):
    text = project.config.read_text()
    project.config.write_text(text.replace("max_error_px = 1.25", "max_error_px = 3.5"))
    ear = Ear()
    assert read_project_options(project, reporter=ear).matching.max_error_px == 3.5
    without = "\n".join(line for line in text.splitlines() if "pixel_size_um" not in line)
    project.config.write_text(without)
    assert read_project_options(project, reporter=ear).ingest.pixel_size_um is None
    assert ear.heard == []


def test_a_project_of_an_older_version_has_the_options_of_its_file(project):
    record = project.record.read_text()
    project.record.write_text(record.replace('"options"', '"other"'))
    project.config.write_text("seed = 9\n")
    assert read_project_options(project) == Config(seed=9)
    assert read_project_options(Project(project.path / "none")) is None
    assert read_config(project.config) == Config(seed=9)
