"""The reduced mesh that carries the texture is as sound as the mesh itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from semsfm_colmap.surface.files import write_textured
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.repair import welded
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.texture.atlas import simplify
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.oracles.sound_mesh import assert_sound
from tests.surface.scene import RADIUS, ball_points


def ragged_ball() -> TriangleMesh:
    """A noisy half of a ball with many small holes."""
    rng = np.random.default_rng(3)
    points = ball_points(12000, seed=3)
    points = points[points[:, 2] < 0.3 * RADIUS]
    normals = points / RADIUS
    holes = points[rng.choice(len(points), 60, replace=False)]
    keep = (np.linalg.norm(points[:, None] - holes, axis=2) > 0.12 * RADIUS).all(axis=1)
    points = points + normals * rng.normal(0.0, 0.004 * RADIUS, (len(points), 1))
    cloud = PointCloud(points=points[keep], normals=normals[keep])
    return mesh_cloud(cloud, SurfaceOptions(fill_holes="none"))


@pytest.mark.parametrize("max_faces", [2000, 400, 100])
def test_a_reduced_mesh_is_sound(max_faces: int, tmp_path: Path) -> None:
    mesh = ragged_ball()
    small = simplify(mesh, max_faces)
    assert 0.8 * max_faces < len(small.faces) <= max_faces
    assert_sound(small, tmp_path)


def test_the_textured_files_are_sound(tmp_path: Path) -> None:
    small = simplify(ragged_ball(), 1000)
    uv = np.random.default_rng(0).random((len(small.faces), 3, 2))
    textured = TriangleMesh(
        vertices=small.vertices,
        faces=small.faces,
        vertex_normals=small.vertex_normals,
        uv=uv,
        texture=np.full((8, 8, 3), 90, dtype=np.uint8),
    )
    for path in write_textured(textured, tmp_path):
        read = trimesh.load(path, force="mesh", process=False)
        assert len(read.faces) == len(small.faces)
        # charts have vertices of their own: joined by place they are the surface
        vertices, faces = welded(np.array(read.vertices), np.array(read.faces))
        assert len(faces) == len(small.faces)
        assert_sound(TriangleMesh(vertices=vertices, faces=faces), tmp_path)
