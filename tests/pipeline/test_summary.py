"""What commands say when they are done, on a project."""

import json
import shutil
from dataclasses import replace

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.registry import STAGE_NAMES
from semsfm_colmap.pipeline.summary import summary


@pytest.fixture(scope="module")
def project(small_project, tmp_path_factory):
    path = tmp_path_factory.mktemp("summary") / "p"
    shutil.copytree(small_project, path)
    return path


def said(project, stages, record=None):
    record = record or RunRecord.read(project / "run.json")
    return "\n".join(summary(Project(project), record, stages))


def test_a_whole_run_ends_with_its_summary_and_quiet_with_none(
    small_series, project, tmp_path, capsys
):
    arguments = ["reconstruct", str(small_series / "images"), "--output_path", str(project)]
    assert main(arguments) == 0
    said = capsys.readouterr().err
    assert "map: up to date" in said
    lines = said.rstrip().split("\n\n")[-1].splitlines()
    assert len(lines) < 24
    metrics = json.loads((project / "report" / "metrics.json").read_text())
    assert f"7 of 7, {metrics['structure']['num_points']} points" in lines[1]
    for name in ("rotation", "hand", "scale", "mesh", "doubts", "files", "next"):
        assert any(line.startswith(f"  {name} ") for line in lines)
    for doubt in metrics["verdict"]["doubts"][:3]:
        assert any(doubt["title"].split("\u202f")[0] in line for line in lines)
    assert main([*arguments, "-q"]) == 0
    assert capsys.readouterr().err == ""


def test_map_alone_speaks_of_nothing_later(project):
    text = said(project, ("map",))
    assert "mesh.ply" not in text
    assert "report.html" not in text
    assert f"semsfm densify {project}" in text
    assert "  mesh " not in text
    assert "  mesh " in said(project, ("mesh",))


def test_a_stage_that_came_to_nothing_is_named(project):
    record = RunRecord.read(project / "run.json")
    record.stages["mesh"] = replace(record.entry("mesh"), status="failed")
    assert "  failed   mesh, see above" in said(project, STAGE_NAMES, record)


def test_the_report_of_an_older_version_is_summed_up_too(project):
    file = project / "report" / "metrics.json"
    kept = file.read_text()
    whole = said(project, STAGE_NAMES)
    old = json.loads(kept)
    del old["verdict"]
    file.write_text(json.dumps(old))
    assert said(project, STAGE_NAMES) == whole
    file.write_text(kept)
