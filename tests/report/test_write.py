import json

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.report import figures, write
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.metrics_json import metrics_json
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.write import write_report
from tests.report.series import chain_of_pairs, make_inputs, make_reconstruction

OPTIONS = ReportOptions(figure_dpi=40)


@pytest.fixture
def few_figures(monkeypatch):
    """Only the figures that tell two reports apart: drawing takes most of the time."""
    kinds = [kind for kind in figures.FIGURES if kind.name in {"rotation", "matches"}]
    monkeypatch.setattr(figures, "FIGURES", tuple(kinds))


def inputs(num_images=4, **more):
    return make_inputs(make_reconstruction(np.arange(num_images) * 6.0), **more)


def read(folder):
    return json.loads((folder / "metrics.json").read_text(encoding="utf-8"))


def test_the_folder_holds_page_metrics_and_figures(tmp_path):
    given = inputs()
    metrics = write_report(given, tmp_path / "deep" / "report", OPTIONS)
    folder = tmp_path / "deep" / "report"
    assert {p.name for p in folder.iterdir()} == {"report.html", "metrics.json", "figures"}
    assert read(folder) == metrics_json(metrics) == metrics_json(compute_metrics(given))
    names = {p.name for p in (folder / "figures").iterdir()}
    assert {"rotation.png", "visibility.png", "scene.png"} <= names
    assert "matches.png" not in names


def test_a_second_report_replaces_the_first_and_leaves_other_files_alone(tmp_path, few_figures):
    given = inputs()
    names = given.reconstruction.image_names
    write_report(inputs(pairs=chain_of_pairs(names)), tmp_path, OPTIONS)
    assert (tmp_path / "figures" / "matches.png").exists()
    (tmp_path / "my notes.txt").write_text("mine")
    metrics = write_report(inputs(5), tmp_path, OPTIONS)
    assert metrics.images.num_given == 5
    assert read(tmp_path) == metrics_json(metrics)
    assert not (tmp_path / "figures" / "matches.png").exists()
    assert (tmp_path / "my notes.txt").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 4


def test_a_report_that_fails_leaves_the_old_one(tmp_path, monkeypatch, few_figures):
    write_report(inputs(), tmp_path, OPTIONS)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def full_disk(drawn, folder):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(write, "_write_figures", full_disk)
    with pytest.raises(UsageError, match="No space left on device"):
        write_report(inputs(6), tmp_path, OPTIONS)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_the_same_inputs_give_the_same_bytes(tmp_path, few_figures):
    for folder in ("a", "b"):
        write_report(inputs(), tmp_path / folder, OPTIONS)
    for path in (tmp_path / "a").rglob("*"):
        if path.is_file():
            other = tmp_path / "b" / path.relative_to(tmp_path / "a")
            assert path.read_bytes() == other.read_bytes()


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path, few_figures):
    (tmp_path / "report").write_text("a file")
    with pytest.raises(UsageError, match="cannot write the report to"):
        write_report(inputs(), tmp_path / "report", OPTIONS)
