"""Cameras, options and projects that an export cannot hold as they are."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, read_scene
from semsfm_colmap.exports.write import export_scene
from semsfm_colmap.pipeline.export import export_project
from tests.exports import readers
from tests.exports.ball_project import image_names


@pytest.fixture
def scene(plain_project: Path) -> ExportScene:
    path = plain_project / "sparse" / "0"
    return read_scene(path, plain_project / "images", FormatOptions())


def with_cameras(scene: ExportScene, **changes: float) -> ExportScene:
    """The scene with other intrinsics; what is measured moves along."""
    made = scene.reconstruction
    cameras = replace(made.cameras, **changes)
    return replace(scene, reconstruction=replace(made, cameras=cameras))


def test_rectangular_pixels_become_two_focal_lengths(scene, tmp_path) -> None:
    stretched = with_cameras(scene, aspect=1.05)
    summary = export_scene(stretched, "colmap-bin", tmp_path / "bin", FormatOptions())
    view = readers.read_binary(tmp_path / "bin").views["view_03.png"]
    assert view.K[1, 1] / view.K[0, 0] == pytest.approx(1.05)
    X = scene.reconstruction.points
    gap = view.project(X) - stretched.reconstruction.cameras.project(X, np.full(len(X), 3))
    # the points that this image does not see lie deeper than those that bound the deviation
    assert np.linalg.norm(gap, axis=1).max() < 3 * summary["max_deviation_px"]
    for name in ("nvm", "bundler"):
        with pytest.raises(InputError, match="square pixels only"):
            export_scene(stretched, name, tmp_path / name, FormatOptions())


def test_a_skew_that_shows_is_refused_and_one_that_does_not_is_stated(scene, tmp_path) -> None:
    with pytest.raises(InputError, match=r"skew of 0\.05, which a pinhole camera lacks"):
        export_scene(with_cameras(scene, skew=0.05), "colmap-bin", tmp_path / "a", FormatOptions())
    slight = with_cameras(scene, skew=0.002)
    summary = export_scene(slight, "colmap-bin", tmp_path / "b", FormatOptions())
    # 0.002 of 44 px, which the stated deviation must include
    assert 0.05 < summary["max_deviation_px"] < 0.1
    export_scene(with_cameras(scene, skew=0.05), "nfh-sem", tmp_path / "c", FormatOptions())


def exported(project, name, folder, **given):
    return export_project(project, name, folder, options=FormatOptions(**given))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"focal_factor": 0.5}, "puts the cameras into the specimen"),
        ({"focal_factor": -1.0}, "focal_factor .* is -1.0: give a number of 0 or more"),
        ({"min_float32_focal_factor": 2000.0}, "give no more than max_float32_focal_factor"),
    ],
)
def test_senseless_focal_lengths_are_usage_errors(plain_project, tmp_path, given, message):
    with pytest.raises(UsageError, match=message):
        exported(plain_project, "colmap-float32", tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()


def test_a_wanted_deviation_sets_the_focal_length(plain_project, tmp_path) -> None:
    deviations = []
    for k, bound in enumerate((0.02, 0.002)):
        options = FormatOptions(max_deviation_px=bound)
        summary = export_project(plain_project, "colmap-bin", tmp_path / str(k), options=options)
        assert 0.5 * bound < summary["max_deviation_px"] <= 1.001 * bound
        deviations.append(summary["max_deviation_px"])
    assert deviations[0] > 5 * deviations[1]


def test_without_depth_maps_the_dense_workspace_says_so(plain_project, tmp_path) -> None:
    project = tmp_path / "p"
    shutil.copytree(plain_project, project)
    shutil.rmtree(project / "dense")
    summary = export_project(project, "colmap-dense")
    assert summary["num_depth_maps"] == 0
    assert "semsfm densify" in summary["notes"][0]
    # PatchMatch can still start from it
    lines = (project / "export/colmap-dense/stereo/patch-match.cfg").read_text().splitlines()
    assert lines[0::2] == list(image_names(False))
    assert all(
        line.split(", ")[0] != name for name, line in zip(lines[0::2], lines[1::2], strict=True)
    )
    assert len((project / "export/colmap-dense/stereo/fusion.cfg").read_text().splitlines()) == 11


def test_explicit_depth_ranges_hold_all_points_and_little_more(plain_project, tmp_path) -> None:
    summary = export_project(plain_project, "colmap-dense", tmp_path / "out")
    scene = readers.read_binary(tmp_path / "out" / "sparse")
    depths = np.concatenate(
        [
            (np.array([scene.points[int(j)] for j in v.point_ids if j >= 0]) @ v.R.T + v.t)[:, 2]
            for v in scene.views.values()
        ]
    )
    assert summary["depth_min"] < depths.min()
    assert depths.max() < summary["depth_max"]
    assert summary["depth_max"] - summary["depth_min"] < 2 * np.ptp(depths)


def test_names_with_commas_are_refused_for_patch_match(scene, tmp_path) -> None:
    names = ("a,b.png", *scene.names[1:])
    odd = replace(scene, names=names)
    with pytest.raises(InputError, match=r"colmap-dense cannot hold the image name .a,b\.png."):
        export_scene(odd, "colmap-dense", tmp_path / "out", FormatOptions())


def test_missing_images_and_models_are_answered_with_a_sentence(plain_project, tmp_path) -> None:
    project = tmp_path / "p"
    shutil.copytree(plain_project, project)
    (project / "images" / "view_03.png").unlink()
    with pytest.raises(InputError, match=r"view_03\.png is missing"):
        export_project(project, "colmap-float32")
    assert not (project / "export" / "colmap-float32").exists()
    with pytest.raises(InputError, match="semsfm map"):
        export_project(project, "colmap-bin", model=3)
    with pytest.raises(UsageError, match="not a folder"):
        export_project(tmp_path / "none", "colmap-bin")
