import csv
import json
import shutil

import numpy as np
import pytest

import semsfm_colmap
from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.specimen import read_specimen


@pytest.fixture(scope="module")
def project(small_project, tmp_path_factory):
    path = tmp_path_factory.mktemp("measured") / "p"
    shutil.copytree(small_project, path)
    return path


@pytest.fixture(scope="module")
def picks(project):
    """Two places on the grain, in the image in the middle."""
    specimen = read_specimen(Project(project))
    image = specimen.model.num_images // 2
    size = specimen.model.image_size_px[image]
    pixels = np.array([size * [0.45, 0.4], size * [0.55, 0.42]]).round() + 0.5
    assert specimen.hits(image, pixels).found.all()
    name = specimen.model.image_names[image]
    return [f"{name}:{x:g},{y:g}" for x, y in pixels]


def test_a_distance_is_measured_and_written(project, picks, capsys):
    assert main(["measure", str(project), "--points", *picks]) == 0
    assert "distance: " in capsys.readouterr().err
    data = json.loads((project / "metrology" / "measurements.json").read_text())
    (one,) = data["measurements"]
    assert one["unit"] == "um"
    budget = one["budget"]
    assert sum(line["share"] for line in budget) == pytest.approx(1.0)
    names = {line["source"] for line in budget}
    assert {"cameras: noise", "cameras: drag", "picking", "pixel size"} <= names
    scale = next(line for line in budget if line["source"] == "pixel size")
    assert scale["contribution"] == pytest.approx(0.03 * one["value"])
    low, high = one["interval_95"]
    assert low < one["value"] < high
    with (project / "metrology" / "measurements.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["value"]) == pytest.approx(one["value"], rel=1e-5)


def test_the_page_shows_budget_interval_and_what_is_not_assessed(project, picks):
    semsfm_colmap.measure(project, points=picks)
    page = (project / "metrology" / "measurements.html").read_text(encoding="utf-8")
    for text in ("combined standard uncertainty", "95 % interval", "Not assessed", "share %", "µm"):
        assert text in page
    assert "<script" not in page


def test_a_run_repeats_what_the_file_asks_for(project, picks, capsys):
    file = project / "measurements.toml"
    file.write_text(
        f'[measurements]\nwidth = {{ distance = ["{picks[0]}", "{picks[1]}"] }}\n'
        f'line = {{ profile = ["{picks[0]}", "{picks[1]}"], samples = 5 }}\n'
    )
    try:
        first = semsfm_colmap.measure(project)
        second = semsfm_colmap.measure(project)
    finally:
        file.unlink()
    assert [one.name for one in first] == ["width", "line"]
    assert [(one.value, one.sigma) for one in first] == [(one.value, one.sigma) for one in second]
    assert len(first[1].profile) == 5


def test_a_part_of_the_segmentation_is_measured_by_its_name(project):
    table = semsfm_colmap.segment_project(project)
    part = table["parts"][0]
    file = project / "measurements.toml"
    file.write_text(f'[measurements]\nskin = {{ area = {{ label = "{part["name"]}" }} }}\n')
    try:
        (found,) = semsfm_colmap.measure(project)
        file.write_text('[measurements]\nbody = { volume = { label = "wing" } }\n')
        with pytest.raises(
            InputError, match=f"no part is named wing: the parts are {part['name']}"
        ):
            semsfm_colmap.measure(project)
        file.write_text(f'[measurements]\nb = {{ volume = {{ label = "{part["name"]}" }} }}\n')
        with pytest.raises(InputError, match="encloses no volume"):
            semsfm_colmap.measure(project)
    finally:
        file.unlink()
    # faces across the border of the part count by their corners
    assert found.value == pytest.approx(part["area"], rel=0.05)


def test_a_known_length_sets_the_scale_and_it_is_said(project, picks):
    (found,) = semsfm_colmap.measure(
        project, points=picks, scale_from=",".join([*picks, "7.5,0.1"])
    )
    assert found.value == pytest.approx(7.5)
    assert found.sigma == pytest.approx(0.1)
    data = json.loads((project / "metrology" / "measurements.json").read_text())
    assert any("the recorded pixel size is not used" in note for note in data["notes"])


def test_bad_requests_end_in_one_sentence(project, picks, capsys):
    assert main(["measure", str(project), "--points", picks[0], "nowhere.tif:3,4"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("semsfm measure: no image is called nowhere.tif: the images are")
    assert len(error.strip().splitlines()) == 1
    assert main(["measure", str(project)]) == 2
    assert "nothing to measure: give --points, or write" in capsys.readouterr().err


def test_a_number_of_places_that_measures_nothing_is_refused(project, picks):
    with pytest.raises(UsageError, match="--points takes 2 or 3 places, not 1"):
        semsfm_colmap.measure(project, points=picks[:1])
    with pytest.raises(UsageError, match="--profile takes 2 places"):
        semsfm_colmap.measure(project, profile=picks[:1])


def test_an_uncertainty_in_percent_is_refused():
    with pytest.raises(UsageError, match=r"pixel_size_sigma .* is 3.0: give a number .* below 1"):
        MetrologyOptions(pixel_size_sigma=3.0)


def test_what_another_program_made_is_not_overwritten(tmp_path):
    (tmp_path / "metrology").mkdir()
    with pytest.raises(UsageError, match="was not made by semsfm"):
        semsfm_colmap.measure(tmp_path, points=["a:1,2", "a:3,4"])
