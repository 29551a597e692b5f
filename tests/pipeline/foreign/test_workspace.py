"""What is found in a COLMAP folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.pipeline.foreign.workspace import find_workspace
from tests.colmap.perspective_models import around, ball, perspective_model, write_model


def put_model(folder: Path, num_images: int = 3) -> Path:
    return write_model(perspective_model(ball(40), around(num_images)), folder)


def put_dense(folder: Path, *, fused: bool = True, maps: bool = True) -> Path:
    if maps:
        (folder / "stereo/depth_maps").mkdir(parents=True)
    if fused:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "fused.ply").write_bytes(b"")
    return folder


def test_the_parts_of_an_automatic_reconstruction_are_found(tmp_path: Path) -> None:
    put_model(tmp_path / "sparse/0")
    put_model(tmp_path / "dense/0/sparse")
    dense = put_dense(tmp_path / "dense/0")
    (tmp_path / "images").mkdir()
    found = find_workspace(tmp_path)
    assert found.model_path == tmp_path / "sparse/0"
    assert found.dense_path == dense
    assert found.fused_path == dense / "fused.ply"
    assert found.maps_model_path == dense / "sparse"
    assert found.image_path == tmp_path / "images"


def test_components_have_the_dense_folder_of_their_number(tmp_path: Path) -> None:
    for k, num in enumerate((3, 6, 4)):
        put_model(tmp_path / f"sparse/{k}", num)
        put_dense(tmp_path / f"dense/{k}")
    found = find_workspace(tmp_path)
    assert found.model_path == tmp_path / "sparse/1"
    assert found.dense_path == tmp_path / "dense/1"
    assert found.other_models == (tmp_path / "sparse/0", tmp_path / "sparse/2")
    other = find_workspace(tmp_path, tmp_path / "sparse/2")
    assert other.dense_path == tmp_path / "dense/2"


def test_ten_comes_after_two_and_the_first_of_equals_is_meant(tmp_path: Path) -> None:
    for k in (10, 2, 11):
        put_model(tmp_path / f"sparse/{k}")
    assert find_workspace(tmp_path).model_path == tmp_path / "sparse/2"


def test_a_folder_around_a_model_has_no_say(tmp_path: Path) -> None:
    put_dense(tmp_path)
    put_model(tmp_path / "w")
    found = find_workspace(tmp_path / "w")
    assert found.fused_path is None
    assert found.dense_path is None


def test_a_model_named_elsewhere_brings_its_own_workspace(tmp_path: Path) -> None:
    put_model(tmp_path / "a/sparse/0")
    put_model(tmp_path / "b/sparse/0")
    put_dense(tmp_path / "b")
    found = find_workspace(tmp_path / "a", tmp_path / "b/sparse/0")
    assert found.model_path == tmp_path / "b/sparse/0"
    assert found.dense_path == tmp_path / "b"


def test_photometric_maps_count_where_there_are_no_geometric_ones(tmp_path: Path) -> None:
    put_model(tmp_path / "sparse")
    put_dense(tmp_path)
    maps = tmp_path / "stereo/depth_maps"
    (maps / "a.png.photometric.bin").write_bytes(b"")
    (maps / "b.png.photometric.bin").write_bytes(b"")
    (maps / "b.png.geometric.bin").write_bytes(b"")
    found = find_workspace(tmp_path)
    assert found.depth_map("a.png") == maps / "a.png.photometric.bin"
    assert found.depth_map("b.png") == maps / "b.png.geometric.bin"
    assert found.depth_map("c.png") is None
    assert found.normal_map("a.png") is None


@pytest.mark.parametrize("flag", ["sparse_path", "image_path"])
def test_a_path_that_is_no_folder_is_named_with_its_flag(flag: str, tmp_path: Path) -> None:
    put_model(tmp_path)
    with pytest.raises(UsageError, match=f"--{flag}"):
        find_workspace(tmp_path, **{flag: tmp_path / "nowhere"})


def test_a_named_folder_without_a_model_is_one_sentence(tmp_path: Path) -> None:
    put_model(tmp_path / "sparse/0")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty holds no COLMAP model"):
        find_workspace(tmp_path, tmp_path / "empty")
