"""What every mesher has to keep: a class that the tests of each one inherit."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.methods.registry import METHODS
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.oracles.sound_mesh import assert_sound
from tests.surface.scene import RADIUS, ball_points

NOISE = 0.01
RIM = 0.3
"""Height, in radii, above which the cap's mesh is compared: some methods go on beyond the rim."""


def cap(num: int = 4000, *, min_z: float = 0.2, seed: int = 1) -> PointCloud:
    """The part of a noisy ball above a height: every method can mesh it."""
    points = ball_points(num, seed=seed)
    normals = points / RADIUS
    keep = normals[:, 2] > min_z
    noise = NOISE * np.random.default_rng(seed).normal(size=(num, 1))
    colors = np.repeat(np.clip(128 + 120 * normals[:, :1], 0, 255), 3, axis=1).astype(np.uint8)
    return PointCloud(
        points=(points + noise * normals)[keep], normals=normals[keep], colors=colors[keep]
    )


def sheet(num_side: int = 40, *, noise: float = 0.0) -> PointCloud:
    """A flat square at z = 0 that faces +z."""
    side = np.linspace(-1.0, 1.0, num_side)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    rng = np.random.default_rng(0)
    jitter = 0.2 * (side[1] - side[0]) * rng.normal(size=(2, len(x)))
    z = noise * rng.normal(size=len(x))
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    return PointCloud(points=np.column_stack([x + jitter[0], y + jitter[1], z]), normals=normals)


class MesherContract:
    """Inherited by the test of each method, which says its name."""

    method: ClassVar[Any]
    options: ClassVar[dict[str, Any]] = {}
    inside: ClassVar[Any] = np.zeros(3)
    """A point that every face of the cap's mesh turns its back to."""

    def mesh(self, cloud: PointCloud, **more: Any) -> Any:
        return mesh_cloud(cloud, SurfaceOptions(method=self.method, **{**self.options, **more}))

    def test_the_registry_knows_it(self) -> None:
        assert METHODS[self.method].mesher()

    def test_the_mesh_is_sound_to_other_libraries(self, tmp_path: Path) -> None:
        assert_sound(self.mesh(cap()), tmp_path)

    @pytest.mark.parametrize("seed", [2, 3])
    def test_scattered_points_give_a_sound_mesh_as_well(self, seed: int, tmp_path: Path) -> None:
        rng = np.random.default_rng(seed)
        cloud = cap(3000, seed=seed)
        noisy = cloud.points + 0.05 * rng.normal(size=cloud.points.shape)
        scattered = PointCloud(points=noisy, normals=cloud.normals)
        assert_sound(self.mesh(scattered), tmp_path)

    def test_it_faces_the_viewers(self) -> None:
        mesh = self.mesh(cap())
        normal = face_normals(mesh.vertices, mesh.faces)
        centre = mesh.vertices[mesh.faces].mean(axis=1)
        outward = np.einsum("fi,fi->f", normal, centre - self.inside)
        assert outward[outward < 0].sum() > -1e-3 * outward.sum()

    def test_it_lies_at_the_points(self) -> None:
        mesh = self.mesh(cap())
        inner = mesh.vertices[mesh.vertices[:, 2] > RIM * RADIUS]
        away = np.abs(np.linalg.norm(inner, axis=1) - RADIUS)
        assert np.median(away) < 1.5 * NOISE
        assert away.max() < 8 * NOISE

    def test_colours_are_those_of_the_points_there(self) -> None:
        mesh = self.mesh(cap())
        inner = mesh.vertices[:, 2] > RIM * RADIUS
        expected = np.clip(128 + 120 * mesh.vertices[:, 0] / RADIUS, 0, 255)
        assert np.abs(mesh.vertex_colors[:, 0] - expected)[inner].mean() < 6.0
        assert mesh.vertex_colors.dtype == np.uint8

    def test_the_area_is_that_of_the_cap(self) -> None:
        mesh = self.mesh(cap())
        inner = mesh.faces[(mesh.vertices[mesh.faces][:, :, 2] > RIM * RADIUS).all(axis=1)]
        area = 0.5 * np.linalg.norm(face_normals(mesh.vertices, inner), axis=1).sum()
        whole = 2 * np.pi * RADIUS**2 * (1 - RIM)
        # triangles across the height do not count: a row of 0.2 of a strip 1.5 wide
        assert 0.85 * whole < area < 1.02 * whole

    def test_the_unit_of_the_world_does_not_matter(self) -> None:
        cloud = cap(2000)
        large = PointCloud(points=1024.0 * cloud.points, normals=cloud.normals)
        mesh, other = self.mesh(cloud), self.mesh(large)
        assert len(other.faces) == pytest.approx(len(mesh.faces), rel=0.01)
        assert np.abs(
            np.ptp(other.vertices, axis=0) / 1024 - np.ptp(mesh.vertices, axis=0)
        ).max() < (0.02)

    def test_the_same_cloud_gives_the_same_mesh(self) -> None:
        first, second = self.mesh(cap(2000)), self.mesh(cap(2000))
        np.testing.assert_array_equal(first.faces, second.faces)
        np.testing.assert_array_equal(first.vertices, second.vertices)

    def test_a_handful_of_points_is_one_sentence(self) -> None:
        with pytest.raises(InputError, match="4 points, too few"):
            self.mesh(PointCloud(points=np.eye(4, 3), normals=np.eye(4, 3)))

    def test_no_points_are_one_sentence(self) -> None:
        empty = np.zeros((0, 3))
        with pytest.raises(InputError, match="0 points, too few"):
            self.mesh(PointCloud(points=empty, normals=empty))

    def test_points_in_one_place_are_one_sentence(self) -> None:
        same = np.tile([[1.0, 2.0, 3.0]], (100, 1))
        with pytest.raises(InputError, match="in one place"):
            self.mesh(PointCloud(points=same, normals=np.tile([[0.0, 0.0, 1.0]], (100, 1))))

    def test_points_on_a_line_are_one_sentence(self) -> None:
        line = np.arange(100.0)[:, None] * [1.0, 0.0, 0.0]
        normals = np.tile([0.0, 0.0, 1.0], (100, 1))
        with pytest.raises(InputError, match="on a line"):
            self.mesh(PointCloud(points=line, normals=normals))

    def test_a_plane_is_its_surface(self, tmp_path: Path) -> None:
        mesh = self.mesh(sheet())
        assert_sound(mesh, tmp_path)
        assert np.abs(mesh.vertices[:, 2]).max() < 0.02
        assert face_normals(mesh.vertices, mesh.faces)[:, 2].min() > -1e-9
        area = 0.5 * np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1).sum()
        assert 3.8 < area < 5.1

    def test_watertight_is_watertight(self, tmp_path: Path) -> None:
        mesh = self.mesh(cap(), watertight=True)
        assert_sound(mesh, tmp_path, watertight=True)

    def test_far_from_the_origin_the_mesh_is_the_same(self, tmp_path: Path) -> None:
        cloud = cap(2000)
        place = np.array([4.5e5, 5.2e6, 800.0])  # metres, as maps count them
        far = self.mesh(PointCloud(points=cloud.points + place, normals=cloud.normals))
        mesh = self.mesh(PointCloud(points=cloud.points, normals=cloud.normals))
        assert len(far.faces) == pytest.approx(len(mesh.faces), rel=0.01)
        extent = np.ptp(mesh.vertices, axis=0)
        np.testing.assert_allclose(np.ptp(far.vertices, axis=0), extent, rtol=0.02)
        assert_sound(far, tmp_path)
        stored = read_ply_mesh(tmp_path / "sound.ply")
        np.testing.assert_array_equal(stored.vertices, far.vertices)
