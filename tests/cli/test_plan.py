import json

import pytest

from semsfm_colmap.cli.main import main
from tests.exports.ball_project import write_project

SMALL = ["--specimen", "field", "--max_total_deg", "30", "--max_frames", "9"]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return write_project(tmp_path_factory.mktemp("plan") / "project", special=False)


def test_one_series_is_predicted_as_text_and_numbers(tmp_path, capsys):
    file = tmp_path / "plan.json"
    flags = ["--num_frames", "7", "--step_deg", "5", "--pixel_size_um", "0.5", "--json", str(file)]
    assert main(["plan", *flags, "--specimen", "field"]) == 0
    text = capsys.readouterr().out
    assert "These are sigmas of noise" in text
    (numbers,) = json.loads(file.read_text())
    assert numbers["total_deg"] == 30.0
    assert numbers["depth_sigma_um"] == pytest.approx(0.5 * numbers["depth_sigma_px"])
    assert f"{numbers['depth_sigma_px']:.3f}" in text


def test_a_wanted_sigma_gives_alternatives_and_a_plot(tmp_path, capsys):
    plot, file = tmp_path / "plan.png", tmp_path / "plan.json"
    flags = ["--depth_sigma_px", "0.6", "--plot", str(plot), "--json", str(file)]
    assert main(["plan", *flags, *SMALL]) == 0
    found = json.loads(file.read_text())
    assert [row["depth_sigma_px"] <= 0.6 for row in found] == [True] * len(found)
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert len(capsys.readouterr().out.splitlines()) == len(found) + 5


def test_a_sigma_in_micrometres_is_one_in_pixels_of_their_size(tmp_path):
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    assert main(["plan", "--depth_sigma_px", "0.6", "--json", str(first), *SMALL]) == 0
    flags = ["--depth_sigma_um", "0.3", "--pixel_size_um", "0.5", "--json", str(second)]
    assert main(["plan", *flags, *SMALL]) == 0
    sizes = [
        [(row["num_frames"], row["total_deg"]) for row in json.loads(file.read_text())]
        for file in (first, second)
    ]
    assert sizes[0] == sizes[1]


def test_a_sigma_out_of_reach_names_the_best_there_is(capsys):
    assert main(["plan", "--depth_sigma_px", "0.01", *SMALL]) == 1
    error = capsys.readouterr().err
    assert "the best, 9 images over 30 degrees" in error
    assert "--max_frames" in error


def test_a_project_gets_angles_to_be_added(project, tmp_path, capsys):
    plot, file = tmp_path / "next.png", tmp_path / "next.json"
    flags = ["--num_added", "1", "--candidate_step_deg", "40", "--json", str(file)]
    assert main(["plan", "--project", str(project), *flags, "--plot", str(plot)]) == 0
    assert "view_00.png" in capsys.readouterr().out
    numbers = json.loads(file.read_text())
    (added,) = numbers["added"]
    assert added["depth_sigma_mean_px"] < numbers["before"]["depth_sigma_mean_px"]
    assert added["depth_sigma_um"] is not None
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_noise_and_priors_given_with_a_project_are_obeyed(project, tmp_path):
    file = tmp_path / "next.json"
    flags = ["--project", str(project), "--num_added", "1", "--candidate_step_deg", "40"]
    found = []
    for given in ([], ["--noise_px", "2"], ["--scale_sigma", "0.05"], ["--drift_sigma_px", "3"]):
        assert main(["plan", *flags, *given, "--json", str(file)]) == 0
        found.append(json.loads(file.read_text()))
    own, noisy, *loose = found
    assert noisy["noise_px"] == 2.0
    assert noisy["before"]["depth_sigma_mean_px"] > own["before"]["depth_sigma_mean_px"]
    for other in loose:
        assert other["noise_px"] == own["noise_px"]
        assert other["before"]["rotation_sigma_deg"] > own["before"]["rotation_sigma_deg"]


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        ([], "give one of"),
        (["--num_frames", "9", "--depth_sigma_px", "1"], "give one of"),
        (["--num_frames", "9"], "--total_deg or --step_deg"),
        (["--num_frames", "9", "--total_deg", "40", "--step_deg", "5"], "one of them"),
        (["--num_frames", "2", "--total_deg", "40"], "three images"),
        (["--num_frames", "9", "--total_deg", "500"], "at most 360"),
        (["--num_frames", "9", "--total_deg", "nan"], "total_deg is nan"),
        (["--depth_sigma_um", "0.1"], "--pixel_size_um"),
        (["--depth_sigma_um", "0.1", "--depth_sigma_px", "1"], "not both"),
        (["--depth_sigma_px", "0"], "depth_sigma_px is 0"),
        (
            ["--depth_sigma_px", "1", "--noise_px", "-1"],
            "noise_px of the given noise options is -1",
        ),
        (
            ["--depth_sigma_px", "1", "--drift_sigma_px", "nan"],
            "drift_sigma_px of the given noise options is nan",
        ),
        (
            ["--depth_sigma_px", "1", "--visible_deg", "90"],
            "visible_deg of the given noise options is 90",
        ),
        (
            ["--depth_sigma_px", "1", "--max_total_deg", "400"],
            "max_total_deg of the specimen options is 400",
        ),
        (["--depth_sigma_px", "1", "--max_frames", "2"], "max_frames of the specimen options is 2"),
        (["--project", "/nowhere"], "/nowhere is not a folder"),
    ],
)
def test_calls_that_are_wrong_are_said_in_a_sentence(flags, word, capsys):
    assert main(["plan", *flags]) == 2
    error = capsys.readouterr().err
    assert word in error
    assert len(error.splitlines()) == 1


def test_a_project_that_is_not_mapped_is_said(tmp_path, capsys):
    assert main(["plan", "--project", str(tmp_path)]) == 1
    assert "run `semsfm map` first" in capsys.readouterr().err


def test_images_that_determine_nothing_are_said(capsys):
    assert main(["plan", "--num_frames", "3", "--total_deg", "300"]) == 1
    assert "do not determine a model" in capsys.readouterr().err


def test_a_plot_that_is_no_png_is_refused(tmp_path, capsys):
    flags = ["--num_frames", "5", "--total_deg", "20", "--plot", str(tmp_path / "plan.pdf")]
    assert main(["plan", *flags, *SMALL]) == 2
    assert "ends in .png" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
