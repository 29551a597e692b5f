"""Every script of examples/ runs as its header says."""

from __future__ import annotations

import runpy
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import semsfm_colmap

EXAMPLES = Path(__file__).parents[2] / "examples"


def main_of(name: str) -> Callable[..., None]:
    main: Callable[..., None] = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    return main


@pytest.fixture
def project(small_project: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_project, tmp_path / "p"))


def test_every_example_has_a_test_and_a_header() -> None:
    for path in EXAMPLES.glob("*.py"):
        assert f'main_of("{path.stem}")' in Path(__file__).read_text(encoding="utf-8")
        assert f"python examples/{path.name}" in path.read_text(encoding="utf-8").split('"""')[1]


def test_quick_start(small_series: Path, project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main_of("quick_start")(small_series / "images", project)
    said = capsys.readouterr().out
    assert "7 cameras" in said
    assert "lengths in um" in said


def test_own_colmap_database(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sparse = tmp_path / "sparse"
    main_of("own_colmap_database")(project / "database.db", sparse, project / "images")
    assert semsfm_colmap.read_model(sparse / "0").num_images == 7
    assert "hand: " in capsys.readouterr().out


def test_mesh_colmap_folder(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main_of("mesh_colmap_folder")(project, tmp_path / "mesh")
    assert (tmp_path / "mesh" / "mesh.ply").is_file()
    assert "faces in" in capsys.readouterr().out


def test_detector_study(
    small_series: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images = tmp_path / "three"
    images.mkdir()
    for path in sorted((small_series / "images").iterdir())[:3]:
        shutil.copy(path, images)
    main_of("detector_study")(images, tmp_path / "study")
    assert "hessian-laplace" in capsys.readouterr().out


def test_goniometer(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # a report that is there would be made anew, which tests/pipeline shows
    (project / "report" / "report.html").unlink()
    main_of("goniometer")(project)
    said = capsys.readouterr().out
    assert "30.0" in said or "29." in said or "30." in said
    assert said.count("+-") == 8


def test_measure_and_roughness(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = semsfm_colmap.read_model(project / "sparse" / "0")
    middle = model.num_images // 2
    name, (width, height) = model.image_names[middle], model.image_size_px[middle]
    places = [f"{name}:{x * width:g},{0.4 * height:g}" for x in (0.45, 0.55)]
    rectangle = (0.42 * width, 0.42 * height, 0.58 * width, 0.58 * height)
    main_of("measure_and_roughness")(project, places, rectangle)
    said = capsys.readouterr().out
    assert "picking (kind B)" in said
    assert "Sdr: " in said
