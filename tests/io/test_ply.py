"""Clouds and meshes survive the way to the disk and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.ply import (
    read_ply_cloud,
    read_ply_file,
    read_ply_mesh,
    write_ply,
    write_ply_file,
)
from semsfm_colmap.types import PointCloud, TriangleMesh


def cloud(num: int = 7) -> PointCloud:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(num, 3))
    return PointCloud(
        points=rng.normal(size=(num, 3)),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        colors=rng.integers(0, 256, (num, 3)).astype(np.uint8),
        sigma=rng.uniform(0.01, 0.1, num),
    )


def mesh() -> TriangleMesh:
    """A unit square in z = 0 that faces -z."""
    return TriangleMesh(
        vertices=np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
        faces=np.array([[0, 2, 1], [0, 3, 2]]),
        vertex_normals=np.tile([0.0, 0, -1], (4, 1)),
        vertex_colors=np.full((4, 3), 9, dtype=np.uint8),
        vertex_sigma=np.array([0.1, 0.2, 0.3, 0.4]),
    )


def test_vertices_keep_their_properties_and_types(tmp_path: Path) -> None:
    kinds = np.dtype([("x", "<f8"), ("count", "<i4"), ("grey", "u1"), ("share", "<f4")])
    rows = np.array([(0.1, -3, 255, 0.5), (2.0, 7, 0, np.nan)], dtype=kinds)
    write_ply_file(tmp_path / "a.ply", rows, comment="two of them")
    read = read_ply_file(tmp_path / "a.ply")
    assert read.faces is None
    assert read.vertices.dtype == kinds
    assert read.vertices.tobytes() == rows.tobytes()
    assert (
        b"\ncomment two of them\nelement vertex 2\nproperty double x\n"
        in (tmp_path / "a.ply").read_bytes()
    )


def test_a_cloud_comes_back_with_all_its_attributes(tmp_path: Path) -> None:
    before = cloud()
    write_ply(tmp_path / "a.ply", before)
    after = read_ply_cloud(tmp_path / "a.ply")
    np.testing.assert_allclose(after.points, before.points, rtol=1e-6)
    assert after.normals is not None
    assert before.normals is not None
    np.testing.assert_allclose(after.normals, before.normals, atol=1e-6)
    assert after.colors is not None
    np.testing.assert_array_equal(after.colors, before.colors)
    assert after.sigma is not None
    assert before.sigma is not None
    np.testing.assert_allclose(after.sigma, before.sigma, rtol=1e-6)


def test_bare_points_and_no_points_come_back(tmp_path: Path) -> None:
    for num in (0, 3):
        write_ply(tmp_path / "a.ply", PointCloud(points=np.ones((num, 3))))
        after = read_ply_cloud(tmp_path / "a.ply")
        assert after.points.shape == (num, 3)
        assert after.normals is None
        assert after.colors is None
        assert after.sigma is None


def test_a_mesh_comes_back_with_its_deviations(tmp_path: Path) -> None:
    before = mesh()
    write_ply(tmp_path / "a.ply", before)
    after = read_ply_mesh(tmp_path / "a.ply")
    assert after.vertex_sigma is not None
    assert before.vertex_sigma is not None
    np.testing.assert_allclose(after.vertex_sigma, before.vertex_sigma, rtol=1e-6)
    write_ply(tmp_path / "a.ply", replace(before, vertex_sigma=None))
    assert read_ply_mesh(tmp_path / "a.ply").vertex_sigma is None


def test_open3d_reads_a_cloud_with_its_deviations(tmp_path: Path) -> None:
    before = cloud()
    write_ply(tmp_path / "a.ply", before)
    read = o3d.t.io.read_point_cloud(str(tmp_path / "a.ply"))
    np.testing.assert_allclose(read.point.positions.numpy(), before.points, rtol=1e-6)
    assert before.sigma is not None
    np.testing.assert_allclose(read.point["sigma"].numpy().ravel(), before.sigma, rtol=1e-6)
    old = o3d.io.read_point_cloud(str(tmp_path / "a.ply"))
    assert before.colors is not None
    np.testing.assert_allclose(255 * np.asarray(old.colors), before.colors, atol=0.5)


def test_a_mesh_comes_back_and_open3d_reads_it(tmp_path: Path) -> None:
    before = mesh()
    write_ply(tmp_path / "m.ply", before)
    after = read_ply_mesh(tmp_path / "m.ply")
    np.testing.assert_array_equal(after.faces, before.faces)
    np.testing.assert_array_equal(after.vertices, before.vertices)
    read = o3d.io.read_triangle_mesh(str(tmp_path / "m.ply"))
    np.testing.assert_array_equal(np.asarray(read.triangles), before.faces)
    np.testing.assert_allclose(np.asarray(read.vertex_normals), before.vertex_normals)


def test_faces_that_close_a_hole_keep_their_mark_and_others_still_read_the_mesh(
    tmp_path: Path,
) -> None:
    mesh = TriangleMesh(
        vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2]]),
        face_filled=np.array([False, True, False]),
    )
    path = tmp_path / "mesh.ply"
    write_ply(path, mesh)
    back = read_ply_mesh(path)
    np.testing.assert_array_equal(back.face_filled, mesh.face_filled)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    seen = o3d.io.read_triangle_mesh(str(path))
    np.testing.assert_array_equal(np.asarray(seen.triangles), mesh.faces)
    unmarked = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces)
    write_ply(path, unmarked)
    assert read_ply_mesh(path).face_filled is None


def test_a_write_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, cloud(3))
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="disk full"):
        write_ply(path, cloud(5))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"solid cube", "not a binary little-endian PLY"),
        (b"ply\nformat ascii 1.0\nend_header\n", "not a binary little-endian PLY"),
    ],
)
def test_another_kind_of_file_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_ply_cloud(tmp_path / "a.ply")


def test_a_file_that_was_cut_short_or_is_missing_is_named(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", mesh())
    data = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "a.ply").write_bytes(data[:-5])
    with pytest.raises(InputError, match=r"a\.ply is cut short"):
        read_ply_mesh(tmp_path / "a.ply")
    with pytest.raises(InputError, match=r"b\.ply does not exist"):
        read_ply_mesh(tmp_path / "b.ply")
    write_ply(tmp_path / "c.ply", cloud())
    with pytest.raises(InputError, match="no faces"):
        read_ply_mesh(tmp_path / "c.ply")


@pytest.mark.parametrize(
    "header",
    [
        "element vertex 99999999999\nproperty float x",
        "element vertex -3\nproperty float x",
        "element vertex many\nproperty float x",
        "element vertex 3",
        "element vertex\nproperty float x",
        "element vertex 1\nproperty quaternion x",
        "element vertex 1\nproperty float x\nproperty float x",
        "element vertex 1\nproperty list uchar int x",
        "element vertex 0\nelement face 99999999999\nproperty list uchar int vertex_indices",
    ],
)
def test_a_header_that_lies_is_refused_in_a_sentence(tmp_path: Path, header: str) -> None:
    path = tmp_path / "a.ply"
    text = f"ply\nformat binary_little_endian 1.0\n{header}\nend_header\n"
    path.write_bytes(text.encode() + bytes(4))
    with pytest.raises(InputError, match=r"a\.ply (is cut short|has a PLY header that is none)"):
        read_ply_file(path)


def test_a_face_of_a_vertex_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    corners = np.eye(3)
    write_ply(path, TriangleMesh(vertices=corners, faces=np.array([[0, 1, 2]])))
    content = path.read_bytes()
    path.write_bytes(content[:-4] + bytes([9, 0, 0, 0]))
    with pytest.raises(InputError, match="vertices that are not there"):
        read_ply_file(path)
