"""Models that COLMAP has changed: what is taken over and what is refused, with the reason."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.colmap.options import AdoptionOptions
from semsfm_colmap.colmap.presets import bundle_adjustment_options, pipeline_options
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.pipeline.adopt import adopt_model
from tests.exports.ball_project import write_databases, write_project


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    project = write_project(tmp_path_factory.mktemp("adopt") / "p", special=True)
    stages = {
        name: {"status": "done", "key": name, "summary": {}}
        for name in ("map", "densify", "mesh", "report")
    }
    text = json.dumps({"format": "semsfm-run", "version": 1, "stages": stages})
    (project / "run.json").write_text(text, encoding="utf-8")
    return project


@pytest.fixture
def project(original: Path, tmp_path: Path) -> Path:
    shutil.copytree(original, tmp_path / "p")
    return tmp_path / "p"


def write(model, folder: Path) -> Path:
    folder.mkdir()
    model.write_binary(str(folder))
    return folder


def opened(project: Path):
    return pycolmap.Reconstruction(str(project / "sparse" / "0"))


def turn(model, image, degrees: float) -> None:
    frame = model.frames[image.frame_id]
    pose = frame.rig_from_world
    R = rotation_from_vector(np.radians([[0.0, degrees, 0.0]]))[0]
    frame.rig_from_world = pycolmap.Rigid3d(
        pycolmap.Rotation3d(R @ pose.rotation.matrix()), np.array(pose.translation)
    )


def test_an_unchanged_model_is_adopted_as_it_is(project, tmp_path) -> None:
    before = read_model(project / "sparse" / "0")
    change = adopt_model(project, write(opened(project), tmp_path / "m"))
    assert change.rotation_deg.max() < 1e-6
    assert change.num_points[0] == change.num_points[1]
    after = read_model(project / "sparse" / "0")
    assert after.image_names == before.image_names
    for name in ("cam_from_world", "scale_px_per_unit", "translation_px"):
        assert np.allclose(getattr(after.cameras, name), getattr(before.cameras, name), atol=1e-6)
    assert np.array_equal(after.observations.xy, before.observations.xy)
    assert after.depth_sign.status == "resolved"
    assert after.world_unit == "um"
    assert after.pixel_size_um == before.pixel_size_um
    residual = np.linalg.norm(after.residuals() - before.residuals(), axis=1)
    assert residual.max() < 1e-6


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "0", "."])
@pytest.mark.parametrize("written", ["binary", "text with CRLF"])
def test_a_model_is_found_below_the_folder_that_is_given(project, tmp_path, place, written) -> None:
    before = read_model(project / "sparse" / "0")
    folder = tmp_path / "work" / place
    folder.mkdir(parents=True)
    if written == "binary":
        opened(project).write_binary(str(folder))
    else:
        opened(project).write_text(str(folder))
        for file in folder.iterdir():
            file.write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    assert adopt_model(project, tmp_path / "work").rotation_deg.max() < 1e-6
    assert read_model(project / "sparse" / "0").image_names == before.image_names


@pytest.mark.parametrize(
    "called",
    [
        lambda name: str(Path(name).with_suffix(".jpg")),
        lambda name: f"images/{name}",
        lambda name: str(Path("a/b", name).with_suffix(".tif")),
    ],
    ids=["suffix", "folder", "both"],
)
def test_images_under_other_suffixes_and_in_other_folders_are_the_same(
    project, tmp_path, called
) -> None:
    before = read_model(project / "sparse" / "0")
    model = opened(project)
    for image in model.images.values():
        image.name = called(image.name)
    change = adopt_model(project, write(model, tmp_path / "m"))
    assert change.num_common_observations == before.inlier.sum()
    after = read_model(project / "sparse" / "0")
    assert after.image_names == before.image_names
    assert np.allclose(after.cameras.cam_from_world, before.cameras.cam_from_world, atol=1e-6)


def test_names_of_which_one_is_another_image_are_refused(project, tmp_path) -> None:
    model = opened(project)
    for number, image in enumerate(model.images.values()):
        image.name = f"images/{image.name}" if number else "images/other.png"
    with pytest.raises(InputError, match="images are missing from the changed model"):
        adopt_model(project, write(model, tmp_path / "m"))


def test_a_text_model_with_a_point_that_is_nowhere_names_the_line(project, tmp_path) -> None:
    model = opened(project)
    model.points3D[min(model.points3D)].xyz = np.full(3, np.nan)
    (tmp_path / "m").mkdir()
    model.write_text(str(tmp_path / "m"))
    with pytest.raises(InputError, match=r"points3D.txt .*line \d+: the point lies at no finite"):
        adopt_model(project, tmp_path / "m")


@pytest.mark.parametrize("path", ["none", "file"])
def test_a_path_without_a_model_is_one_sentence(project, tmp_path, path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="is not a folder"):
        adopt_model(project, tmp_path / path)
    with pytest.raises(InputError, match="holds no COLMAP model"):
        adopt_model(project, tmp_path)


def test_a_bundle_adjusted_model_in_another_world_comes_back_into_ours(project, tmp_path) -> None:
    before = read_model(project / "sparse" / "0")
    model = opened(project)
    pycolmap.bundle_adjustment(model, bundle_adjustment_options())
    rotation = pycolmap.Rotation3d(rotation_from_vector(np.array([[0.3, -0.2, 0.5]]))[0])
    model.transform(pycolmap.Sim3d(7.0, rotation, np.array([1.0, 2.0, 3.0])))
    change = adopt_model(project, write(model, tmp_path / "m"))
    # magnification is px per unit: a world 7 times larger has 1/7 of it
    assert change.world_scale == pytest.approx(1 / 7.0, rel=1e-4)
    assert change.rotation_deg.max() < 0.02
    after = read_model(project / "sparse" / "0")
    gap = np.linalg.norm(after.points - before.points, axis=1) / before.pixel_size_um
    assert np.median(gap) < 0.1
    turned = after.cameras.cam_from_world @ np.swapaxes(before.cameras.cam_from_world, 1, 2)
    assert np.degrees(rotation_angle(turned)).max() < 0.02
    mean = [float(np.mean(np.log(m.cameras.scale_px_per_unit))) for m in (before, after)]
    assert mean[0] == pytest.approx(mean[1], abs=1e-9)
    kept = read_model(project / "sparse_before_adoption" / "0")
    assert np.array_equal(kept.points, before.points)


def test_a_triangulated_model_is_adopted_and_what_depends_on_it_is_stale(project, tmp_path) -> None:
    database = write_databases(tmp_path, read_model(project / "sparse" / "0"))[1]
    (tmp_path / "m").mkdir()
    pycolmap.triangulate_points(
        opened(project),
        str(database),
        str(project / "images"),
        str(tmp_path / "m"),
        options=pipeline_options(),
    )
    change = adopt_model(project, tmp_path / "m")
    assert change.rotation_deg.max() < 1e-6
    assert change.num_points[1] > 0.95 * change.num_points[0]
    stages = json.loads((project / "run.json").read_text())["stages"]
    assert stages["map"]["status"] == "done"
    assert "adopted" in stages["map"]["summary"]["notes"][0]
    assert {stages[n]["status"] for n in ("densify", "mesh", "report")} == {"stale"}


def test_a_freed_focal_length_is_refused(project, tmp_path) -> None:
    model = opened(project)
    for camera in model.cameras.values():
        f, cx, cy = camera.params
        camera.params = [1.01 * f, cx, cy]
    with pytest.raises(InputError, match="focal length was freed"):
        adopt_model(project, write(model, tmp_path / "m"))


def test_a_camera_that_turned_is_refused_by_name(project, tmp_path) -> None:
    model = opened(project)
    turn(model, next(i for i in model.images.values() if i.name == "ü.png"), 2.0)
    changed = write(model, tmp_path / "m")
    before = (project / "sparse" / "0" / "images.bin").read_bytes()
    with pytest.raises(InputError, match=r"ü\.png turned by [12]\.\d+ degrees.*fit worse") as info:
        adopt_model(project, changed)
    assert "\n" not in str(info.value)
    assert (project / "sparse" / "0" / "images.bin").read_bytes() == before
    change = adopt_model(project, changed, dry_run=True)
    assert not change.accepted
    assert len(change.reasons) >= 2
    tolerant = AdoptionOptions(max_rotation_deg=5.0, max_error_increase=1e3)
    assert adopt_model(project, changed, options=tolerant).accepted


def test_a_changed_magnification_is_refused(project, tmp_path) -> None:
    model = opened(project)
    image = next(i for i in model.images.values() if i.name == "sub/c.png")
    frame = model.frames[image.frame_id]
    pose = frame.rig_from_world
    frame.rig_from_world = pycolmap.Rigid3d(pose.rotation, 1.02 * np.array(pose.translation))
    with pytest.raises(
        InputError, match=r"magnification of sub/c\.png changed by a factor of 0\.98"
    ):
        adopt_model(project, write(model, tmp_path / "m"))


def test_missing_images_are_refused_by_name(project, tmp_path) -> None:
    model = opened(project)
    image = next(i for i in model.images.values() if i.name == "a b.png")
    model.deregister_frame(image.frame_id)
    with pytest.raises(InputError, match=r"refused: 1 of 11 images are missing.*a b\.png"):
        adopt_model(project, write(model, tmp_path / "m"))


def test_lost_observations_are_refused(project, tmp_path) -> None:
    model = opened(project)
    for point_id in sorted(model.points3D)[: int(0.7 * len(model.points3D))]:
        model.delete_point3D(point_id)
    with pytest.raises(InputError, match="of the observations are gone"):
        adopt_model(project, write(model, tmp_path / "m"))


def test_the_project_s_own_model_is_no_changed_model(project) -> None:
    with pytest.raises(UsageError, match="own model"):
        adopt_model(project, project / "sparse" / "0")


def test_the_command_line_adopts_and_refuses(project, tmp_path, capsys) -> None:
    changed = write(opened(project), tmp_path / "m")
    assert main(["adopt", str(project), "--model_path", str(changed), "--dry_run"]) == 0
    assert "acceptable" in capsys.readouterr().out
    assert main(["adopt", str(project), "--model_path", str(changed)]) == 0
    assert "adopted" in capsys.readouterr().out
    assert main(["adopt", str(project), "--model_path", str(tmp_path / "none")]) == 2
    assert "is not a folder" in capsys.readouterr().err
    assert main(["export", str(project), "--to", "colmap-bin", "-q"]) == 0
    assert (project / "export" / "colmap-bin" / "points3D.bin").is_file()
