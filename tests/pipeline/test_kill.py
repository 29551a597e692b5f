"""SIGKILL at any moment: nothing half-written, and the next run ends with the same model."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.config import Config, preset
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

TINY = SynthesizeOptions(
    scene="grain",
    num_images=5,
    step_deg=5.0,
    width_px=280,
    height_px=240,
    databar=False,
    supersampling=1,
    mesh_edge_px=4.0,
    image_format="tif",
)
UP_TO_DENSE = ("ingest", "extract", "match", "map", "densify")
MODEL_FILES = ("points3D.bin", "images.bin", "orthographic.json")


@pytest.fixture(scope="module")
def tiny_images(tmp_path_factory):
    return synthesize(tmp_path_factory.mktemp("tiny"), TINY)


@pytest.fixture(scope="module")
def undisturbed(tiny_images, tmp_path_factory):
    """The project that nobody killed, without what shows it."""
    project = tmp_path_factory.mktemp("undisturbed") / "p"
    run_stages(project, preset("low"), names=UP_TO_DENSE, image_path=tiny_images)
    return project


def assert_same_model(project, other):
    for name in MODEL_FILES:
        first, second = (p / "sparse" / "0" / name for p in (project, other))
        assert first.read_bytes() == second.read_bytes()


def start(images, project):
    return subprocess.Popen(
        [
            sys.executable,
            "-m",
            "semsfm_colmap.cli.main",
            "reconstruct",
            str(images),
            "--output_path",
            str(project),
            "--quality",
            "low",
            "-q",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["extract", "match", "map", "densify"])
def test_a_killed_run_is_finished_by_the_next_one(stage, tiny_images, undisturbed, tmp_path):
    project = tmp_path / "p"
    process = start(tiny_images, project)
    record = project / "run.json"
    # wait until the stage has begun, then let it get somewhere
    while process.poll() is None:
        if record.is_file() and f'"{stage}"' in record.read_text():
            break
        time.sleep(0.02)
    time.sleep(0.2)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    run_stages(project, preset("low"), names=UP_TO_DENSE, image_path=tiny_images)
    assert_same_model(project, undisturbed)
    with pycolmap.Database.open(str(project / "database.db")) as db:
        assert db.num_images() == TINY.num_images
        assert db.num_verified_image_pairs() > 6
    assert (project / "dense" / "fused.ply").is_file()
    assert not [p for p in project.rglob(".*") if p.name.endswith((".part", ".old"))]


def test_a_run_that_died_while_it_prepared_the_images_can_be_repeated(
    small_series, tmp_path, monkeypatch
):
    def die(*args, **kwargs):
        raise KeyboardInterrupt

    images, project = small_series / "images", tmp_path / "p"
    monkeypatch.setattr("semsfm_colmap.ingest.prepare.write_series", die)
    with pytest.raises(KeyboardInterrupt):
        run_stages(project, Config(), names=("ingest",), image_path=images)
    monkeypatch.undo()
    assert any((project / "images").iterdir())
    assert not (project / "run.json").exists()
    run_stages(project, Config(), names=("ingest",), image_path=images)
    assert len(list((project / "images").iterdir())) == 7


@pytest.mark.slow
def test_random_moments_of_a_run_end_with_the_same_model(tiny_images, tmp_path):
    # python -m benchmarks.reliability with 50 moments is run by hand
    command = [sys.executable, "-m", "benchmarks.reliability", "--only", "kills"]
    command += ["--number", "2", "--seed", "5"]
    command += ["--images", str(tiny_images), "--output", str(tmp_path / "out")]
    command += ["--", "--quality", "low"]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=root)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| all | 2 | 2 |" in done.stdout


@pytest.mark.slow
def test_a_second_process_is_refused_in_one_sentence_and_does_no_harm(
    tiny_images, undisturbed, tmp_path
):
    project = tmp_path / "p"
    first = start(tiny_images, project)
    while not (project / "run.json").is_file():
        assert first.poll() is None
        time.sleep(0.02)
    refused = 0
    while first.poll() is None and refused < 2:
        second = start(tiny_images, project)
        _, err = second.communicate(timeout=300)
        if second.returncode == 0:
            break  # it came after the first had ended
        assert second.returncode == 2
        sentence = f"semsfm reconstruct: {project} is in use by another semsfm process: "
        assert err.decode() == sentence + "wait for it or stop it\n"
        refused += 1
    _, err = first.communicate(timeout=300)
    assert first.returncode == 0, err.decode()
    assert refused > 0
    assert_same_model(project, undisturbed)
