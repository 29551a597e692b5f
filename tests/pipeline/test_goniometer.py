import csv
import json
import shutil

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import InputError, SemSfmError, UsageError
from semsfm_colmap.pipeline.goniometer import measure_rotation, read_goniometer, stage_moves
from semsfm_colmap.pipeline.project import Project
from tests.report.test_goniometer import inputs_of, noisy

FACTOR = 140.0


@pytest.fixture
def project(small_project, tmp_path):
    return shutil.copytree(small_project, tmp_path / "p")


@pytest.fixture
def unreported(project):
    """The project without a report, which takes longer than what is measured."""
    (project / "report" / "report.html").unlink()
    return project


def table_of(project, path, deg_per_um=FACTOR, noise_deg=0.05):
    """Displacements that the images' own angles would have, in shuffled lines."""
    angles = json.loads((project / "report" / "metrics.json").read_text())["per_image"]
    rng = np.random.default_rng(0)
    lines = [
        f"{image['name']},{(image['angle_deg'] + noise_deg * rng.normal()) / deg_per_um:.6f}"
        for image in angles
    ]
    path.write_text("\n".join(["image,displacement_um", *rng.permutation(lines)]) + "\n")
    return path


def test_a_project_is_measured_against_a_table_and_its_report_has_a_section(project, tmp_path):
    record = measure_rotation(project, displacement_path=table_of(project, tmp_path / "d.csv"))
    factor = record.conversion_deg_per_um
    assert abs(factor.value - FACTOR) < 3 * factor.sigma
    assert factor.sigma < 0.02 * FACTOR
    data = json.loads((project / "report" / "goniometer.json").read_text())
    assert data["format"] == "semsfm-goniometer"
    assert data["conversion_deg_per_um"] == {"value": factor.value, "sigma": factor.sigma}
    assert data["hysteresis_deg"] is None
    for key in ("axis_world", "axis_camera", "wobble_deg_rms", "images"):
        assert data[key]
    image = next(iter(data["images"].values()))
    assert {"angle_deg", "sigma_deg", "displacement_um", "residual_deg", "shift_px"} <= set(image)
    page = (project / "report" / "report.html").read_text()
    assert "° per µm" in page
    assert (project / "report" / "figures" / "goniometer_line.png").is_file()


def test_the_sigma_of_the_conversion_holds_that_of_the_total_rotation(unreported, tmp_path):
    record = measure_rotation(
        unreported, displacement_path=table_of(unreported, tmp_path / "d.csv", noise_deg=0.0)
    )
    said = json.loads((unreported / "sparse/0/orthographic.json").read_text())["reliability"]
    relative = record.conversion_deg_per_um.sigma / record.conversion_deg_per_um.value
    total = said["total_rotation_sigma_deg"] / said["total_rotation_deg"]
    assert 0.6 * total < relative < 1.4 * total


def test_without_displacements_there_is_an_axis_and_no_conversion(unreported):
    record = measure_rotation(unreported)
    assert record.conversion_deg_per_um is None
    assert record.axis_camera_sigma_deg > 0.0
    assert read_goniometer(Project(unreported)) == record


def test_the_table_of_moves_has_a_line_an_image_and_starts_at_rest():
    record = inputs_of(noisy()).goniometer
    rows = list(csv.DictReader(stage_moves(record).splitlines()))
    assert [row["image"] for row in rows] == list(record.images)
    assert all(float(rows[0][f"move_{axis}_um"]) == 0.0 for axis in "xyz")
    for row, image in zip(rows, record.images.values(), strict=True):
        assert float(row["move_x_um"]) == pytest.approx(image.move[0], abs=1e-4)
        assert float(row["displacement_um"]) == pytest.approx(image.displacement_um, abs=1e-4)


def test_few_images_give_no_moves_and_that_is_said(unreported):
    record = measure_rotation(unreported)
    assert stage_moves(record) == ""
    assert not (unreported / "report" / "stage_moves.csv").exists()
    assert any("no stage moves" in note for note in record.notes)


def test_what_was_measured_on_another_model_is_no_longer_shown(unreported):
    measure_rotation(unreported)
    sidecar = unreported / "sparse/0/orthographic.json"
    sidecar.write_text(sidecar.read_text() + "\n")
    assert read_goniometer(Project(unreported)) is None
    (unreported / "report" / "goniometer.json").write_text("{")
    assert read_goniometer(Project(unreported)) is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,displacement_nm\na.png,100\n", "no value in a column displacement_um"),
        ("image,displacement_um\na.png,1\nb.png,2\n", "none of the images named"),
    ],
)
def test_a_bad_table_ends_the_command_with_one_sentence(project, tmp_path, capsys, text, said):
    file = tmp_path / "d.csv"
    file.write_text(text)
    assert main(["goniometer", str(project), "--displacement", str(file)]) != 0
    errors = capsys.readouterr().err.strip()
    assert said in errors
    assert len(errors.splitlines()) == 1
    assert not (project / "report" / "goniometer.json").exists()


def test_folders_without_a_model_are_refused(tmp_path):
    with pytest.raises(UsageError, match="is not a folder"):
        measure_rotation(tmp_path / "nothing")
    with pytest.raises((InputError, SemSfmError)):
        measure_rotation(tmp_path)
