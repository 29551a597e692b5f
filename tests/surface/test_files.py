"""Textured meshes and depth maps survive the way to the disk and back."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.surface.files import (
    DepthMapFolder,
    read_depth_map,
    read_textured,
    write_depth_map,
    write_shading,
    write_textured,
)
from semsfm_colmap.surface.shading import Shading
from semsfm_colmap.synthetic.primitives import geodesic_sphere
from semsfm_colmap.types import DepthMap, TriangleMesh


def square(*, textured: bool = False) -> TriangleMesh:
    """A unit square in z = 0 that faces -z, its texture's left half dark, right half bright."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    texture = np.full((8, 8, 3), 200, dtype=np.uint8)
    texture[:, :4] = 50
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=np.tile([0.0, 0, -1], (4, 1)),
        vertex_colors=np.full((4, 3), 9, dtype=np.uint8),
        uv=vertices[faces][:, :, :2] if textured else None,
        texture=texture if textured else None,
    )


def test_a_textured_mesh_shows_the_texture_where_it_belongs(tmp_path: Path) -> None:
    glb, obj = write_textured(square(textured=True), tmp_path)
    assert {p.suffix for p in tmp_path.iterdir()} == {".glb", ".obj", ".mtl", ".png"}
    for path in (glb, obj):
        read = trimesh.load(path, force="mesh", process=False)
        assert len(read.faces) == 2
        colors = np.asarray(read.visual.to_color().vertex_colors)[:, 0]
        left = read.vertices[:, 0] < 0.5
        np.testing.assert_array_equal(colors[left], 50)
        np.testing.assert_array_equal(colors[~left], 200)


def cut_ball() -> TriangleMesh:
    """A ball whose every face has a place of its own in the texture."""
    vertices, faces = geodesic_sphere(2)
    rng = np.random.default_rng(3)
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertices / np.linalg.norm(vertices, axis=1, keepdims=True),
        uv=rng.random((len(faces), 3, 2)),
        texture=np.full((8, 8, 3), 90, dtype=np.uint8),
    )


def test_the_obj_is_in_one_piece_whatever_the_seams_of_its_texture(tmp_path: Path) -> None:
    mesh = cut_ball()
    _, obj = write_textured(mesh, tmp_path)
    lines = [line.split() for line in obj.read_text().splitlines()]
    corners = [[c.split("/") for c in line[1:]] for line in lines if line[0] == "f"]
    place, texture, normal = np.moveaxis(np.array(corners, dtype=np.int64) - 1, 2, 0)
    np.testing.assert_array_equal(place, mesh.faces)
    np.testing.assert_array_equal(normal, mesh.faces)
    for key, rows, expected in (
        ("v", place, mesh.vertices[mesh.faces]),
        ("vn", normal, mesh.vertex_normals[mesh.faces]),
        ("vt", texture, mesh.uv),
    ):
        table = np.array([line[1:] for line in lines if line[0] == key], dtype=np.float64)
        np.testing.assert_allclose(table[rows], expected, atol=1e-6)


def test_normals_of_the_glb_are_stored_and_continuous_over_seams(tmp_path: Path) -> None:
    mesh = cut_ball()
    glb, _ = write_textured(mesh, tmp_path)
    content = glb.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    assert "NORMAL" in json.loads(content[20 : 20 + length])["meshes"][0]["primitives"][0][
        "attributes"
    ]  # fmt: skip
    read = read_textured(glb)
    assert len(read.vertices) == 3 * len(mesh.faces)
    away = read.vertices / np.linalg.norm(read.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(read.vertex_normals, away, atol=1e-6)


def test_the_shading_has_the_law_and_the_gain_of_each_image_by_name(tmp_path: Path) -> None:
    shading = Shading(gradient=np.array([0.1, -0.2, 0.5]), gain=np.array([0.9, 1.2]))
    write_shading(shading, ("a.png", "b.tif"), tmp_path / "shading.json")
    assert json.loads((tmp_path / "shading.json").read_text()) == {
        "gradient": [0.1, -0.2, 0.5],
        "gain": {"a.png": 0.9, "b.tif": 1.2},
    }


def test_a_mesh_without_texture_is_not_written_as_a_textured_one(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="texture"):
        write_textured(square(), tmp_path)


def test_a_depth_map_comes_back_with_unknown_pixels_unknown(tmp_path: Path) -> None:
    depth = np.arange(12, dtype=np.float32).reshape(3, 4) / 7
    depth[1, 2] = np.nan
    confidence = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    name = "series/view 01.tif"
    write_depth_map(tmp_path, DepthMap(image_name=name, depth=depth, confidence=confidence))
    after = read_depth_map(tmp_path, name)
    np.testing.assert_array_equal(after.depth, depth)
    assert after.confidence is not None
    np.testing.assert_allclose(after.confidence, confidence, atol=0.5 / 255 + 1e-6)


@pytest.mark.filterwarnings("error")
def test_a_sigma_beyond_half_precision_is_infinite_without_a_word(tmp_path: Path) -> None:
    depth = np.zeros((2, 2), dtype=np.float32)
    sigma = np.array([[0.5, 1e6], [np.inf, 3.0]], dtype=np.float32)
    write_depth_map(tmp_path, DepthMap(image_name="a.png", depth=depth, sigma=sigma))
    np.testing.assert_array_equal(
        read_depth_map(tmp_path, "a.png").sigma, [[0.5, np.inf], [np.inf, 3.0]]
    )


def test_a_folder_of_depth_maps_is_read_one_by_one(tmp_path: Path) -> None:
    names = ("b.png", "a.png", "c.png")
    for k, name in enumerate(names):
        write_depth_map(tmp_path, DepthMap(image_name=name, depth=np.full((2, 2), k, np.float32)))
    folder = DepthMapFolder(tmp_path, names)
    assert [d.image_name for d in folder] == list(names)
    assert folder[1:][0].depth[0, 0] == 1.0


def test_a_missing_or_broken_depth_map_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x\.png\.npz is missing"):
        read_depth_map(tmp_path, "x.png")
    (tmp_path / "x.png.npz").write_bytes(io.BytesIO(b"nothing").read())
    with pytest.raises(InputError, match="not a depth map"):
        read_depth_map(tmp_path, "x.png")


def test_a_textured_mesh_is_read_as_it_was_written(tmp_path):
    mesh = square(textured=True)
    glb, _ = write_textured(mesh, tmp_path)
    read = read_textured(glb)
    np.testing.assert_allclose(read.vertices[read.faces], mesh.vertices[mesh.faces])
    np.testing.assert_allclose(read.uv, mesh.uv, atol=1e-6)
    np.testing.assert_array_equal(read.texture, mesh.texture)
    np.testing.assert_allclose(read.vertex_normals[:, 2], -1.0)


@pytest.mark.parametrize("data", [b"", b"glTF", b"no mesh at all" * 20])
def test_what_is_no_textured_mesh_is_told(tmp_path, data):
    path = tmp_path / "mesh.glb"
    path.write_bytes(data)
    with pytest.raises(InputError, match="no textured mesh"):
        read_textured(path)


def test_a_depth_map_damaged_anywhere_is_read_or_refused_in_a_sentence(tmp_path) -> None:
    rng = np.random.default_rng(0)
    depth = rng.normal(size=(12, 9)).astype(np.float32)
    path = write_depth_map(tmp_path, DepthMap(image_name="x.png", depth=depth))
    content, refused = path.read_bytes(), 0
    for k in range(400):
        data = bytearray(content)
        at = int(rng.integers(len(data)))
        if k % 2:
            data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(data if k % 2 else data[:at])
        try:
            read_depth_map(tmp_path, "x.png")
        except InputError:
            refused += 1
    assert refused > 200


def test_a_gltf_viewer_shows_the_mesh_upright_and_from_the_front(tmp_path) -> None:
    mesh = square(textured=True)
    glb, _ = write_textured(mesh, tmp_path)
    shown = trimesh.load_scene(glb).to_geometry()
    top = mesh.vertices[:, 1].min()  # y down: the top of the image
    assert shown.vertices[:, 1].max() == -top
    front = np.asarray(shown.face_normals)
    assert np.allclose(front, [0, 0, 1])  # it faced -z, toward the microscope's viewer
    assert np.allclose(read_textured(glb).vertices[:, 1].max(), mesh.vertices[:, 1].max())
