"""Reading the truth of a series, and saying what is wrong with a folder that has none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation import load_truth
from semsfm_colmap.synthetic import SynthesizeOptions, synthesize
from tests.evaluation.series import bumpy_ball, make_truth, write_truth


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_truth(tmp_path, make_truth(mesh=bumpy_ball()))
    return tmp_path


def changed(folder: Path, **entries: Any) -> None:
    file = folder / "truth.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def test_what_was_written_is_read_back(folder: Path) -> None:
    expected, truth = make_truth(mesh=bumpy_ball()), load_truth(folder)
    assert truth.names == expected.names
    assert truth.unit_um == expected.unit_um
    assert truth.image_size_px == expected.image_size_px
    for name in ("cam_from_world", "scale_px_per_unit", "translation_px"):
        np.testing.assert_allclose(getattr(truth.cameras, name), getattr(expected.cameras, name))
    assert truth.mesh is not None
    assert expected.mesh is not None
    np.testing.assert_array_equal(truth.mesh.faces, expected.mesh.faces)


def test_the_file_itself_may_be_given(folder: Path) -> None:
    assert load_truth(folder / "truth.json").path == folder


def test_a_truth_without_surface_is_fine(tmp_path: Path) -> None:
    write_truth(tmp_path, make_truth())
    assert load_truth(tmp_path).mesh is None


def test_the_truth_of_a_rendered_series_is_understood(tmp_path: Path) -> None:
    options = SynthesizeOptions(
        num_images=2, width_px=64, height_px=80, databar_rows=16, mesh_edge_px=4.0
    )
    synthesize(tmp_path, options)
    truth = load_truth(tmp_path)
    assert truth.image_size_px == (64, 64)
    # Natural size: a grain of radius 15 um, 1.52 radii to the edge of 32 px.
    assert truth.pixel_size_um == pytest.approx(15.0 * 1.52 / 32.0, rel=1e-3)
    assert truth.mesh is not None
    middle = truth.cameras.project(np.zeros((2, 3)), np.arange(2))
    assert np.all(np.abs(middle - 32.0) < 6 * options.stage_drift_px)


def test_the_image_area_and_the_intrinsics_are_taken_into_account(folder: Path) -> None:
    before = load_truth(folder)
    changed(folder, image_area=[10, 20, 110, 220], K2=[[2.0, 0.1], [0.0, 2.2]])
    after = load_truth(folder)
    x = np.array([[0.3, -0.2, 0.5]])
    expected = before.cameras.project(x, np.array([3])) - before.cameras.translation_px[3]
    expected = expected @ np.array([[2.0, 0.1], [0.0, 2.2]]).T
    expected = expected + before.cameras.translation_px[3] - [10, 20]
    np.testing.assert_allclose(after.cameras.project(x, np.array([3])), expected)
    assert after.image_size_px == (100, 200)


def test_a_folder_without_truth_says_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no truth\.json: give the folder"):
        load_truth(tmp_path)
    with pytest.raises(InputError, match=r"holds no truth\.json"):
        load_truth(tmp_path / "missing")


def test_a_broken_file_is_named(folder: Path) -> None:
    (folder / "truth.json").write_text("{not json")
    with pytest.raises(InputError, match=r"truth\.json is not JSON"):
        load_truth(folder)


@pytest.mark.parametrize("key", ["frames", "K2", "unit_um", "image_area", "rotation_axis_cam"])
def test_a_missing_entry_is_named(folder: Path, key: str) -> None:
    content = json.loads((folder / "truth.json").read_text())
    del content[key]
    (folder / "truth.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=f"lacks '{key}'"):
        load_truth(folder)


def test_a_list_instead_of_an_object_is_refused(folder: Path) -> None:
    (folder / "truth.json").write_text("[1, 2]")
    with pytest.raises(InputError, match="cannot be understood"):
        load_truth(folder)


def test_matrices_that_are_not_rotations_are_refused(folder: Path) -> None:
    frames = json.loads((folder / "truth.json").read_text())["frames"]
    frames[2]["R"][0][0] += 0.01
    changed(folder, frames=frames)
    with pytest.raises(InputError, match="not rotations"):
        load_truth(folder)


def test_mirrored_rotations_are_refused(folder: Path) -> None:
    frames = json.loads((folder / "truth.json").read_text())["frames"]
    frames[0]["R"] = np.diag([1.0, 1.0, -1.0]).tolist()
    changed(folder, frames=frames)
    with pytest.raises(InputError, match="not rotations"):
        load_truth(folder)


def test_the_same_image_twice_is_refused(tmp_path: Path) -> None:
    truth = make_truth()
    write_truth(tmp_path, replace(truth, names=(truth.names[0], *truth.names[:-1])))
    with pytest.raises(InputError, match="twice"):
        load_truth(tmp_path)


def test_a_size_that_is_not_positive_is_refused(folder: Path) -> None:
    changed(folder, unit_um=0.0)
    with pytest.raises(InputError, match="not positive"):
        load_truth(folder)


def test_a_surface_whose_faces_lack_vertices_is_refused(folder: Path) -> None:
    np.savez(folder / "mesh.npz", vertices=np.zeros((2, 3)), faces=np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match=r"mesh\.npz holds faces"):
        load_truth(folder)


def test_a_file_that_is_no_surface_is_refused(folder: Path) -> None:
    np.savez(folder / "mesh.npz", points=np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"mesh\.npz is not a surface"):
        load_truth(folder)
    (folder / "mesh.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"mesh\.npz is not a surface"):
        load_truth(folder)
