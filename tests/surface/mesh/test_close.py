"""Every hole is closed, and a sheet becomes a slab."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.surface.mesh.close import FLOOR_DEPTH, MAX_CORNERS, close_holes
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.halfedges import num_boundary_edges
from semsfm_colmap.surface.mesh.measure import area, measure, volume
from semsfm_colmap.surface.mesh.repair import compact, in_large_components
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.oracles.sound_mesh import assert_sound
from tests.surface.mesh.sheets import grid
from tests.surface.scene import RADIUS, ball_points

CUBE_VERTICES = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def test_a_closed_mesh_stays_as_it_is() -> None:
    vertices, faces, _ = close_holes(CUBE_VERTICES, CUBE, None)
    np.testing.assert_array_equal(faces, CUBE)
    assert volume(vertices, faces) == pytest.approx(1.0)
    assert area(vertices, faces) == pytest.approx(6.0)


def test_an_open_box_gets_its_lid_back() -> None:
    vertices, faces, _ = close_holes(CUBE_VERTICES, CUBE[:-2], None)
    assert num_boundary_edges(faces) == 0
    assert volume(vertices, faces) == pytest.approx(1.0)
    assert len(vertices) == 8


@pytest.mark.parametrize("n", [4, 30, 60])
def test_a_sheet_becomes_a_slab(n: int, tmp_path: Path) -> None:
    vertices, faces = grid(n)
    # the longest is straight between its corners, and gets a vertex in the middle of the floor
    assert (4 * (n - 1) > MAX_CORNERS) == (n == 60)
    colors = np.arange(n * n)[:, None].repeat(3, 1).astype(np.uint8)
    closed, slab, painted = close_holes(vertices, faces, colors)
    assert painted is not None
    assert len(painted) == len(closed)
    side = n - 1.0
    assert num_boundary_edges(slab) == 0
    assert volume(closed, slab) == pytest.approx(side**2 * FLOOR_DEPTH * side)
    assert area(closed, slab) == pytest.approx(2 * side**2 + 4 * side * FLOOR_DEPTH * side)
    assert_sound(TriangleMesh(vertices=closed, faces=slab), tmp_path, watertight=True)


@pytest.mark.parametrize("min_z", [-0.9, -0.5])
@pytest.mark.parametrize("method", ["ball-pivoting", "tsdf"])
def test_a_ball_with_a_large_hole_becomes_a_ball_with_a_flat_lid(min_z, method, tmp_path) -> None:
    points = ball_points(6000)
    points = points[points[:, 2] > min_z * RADIUS]
    cloud = PointCloud(points=points, normals=points / RADIUS)
    mesh = mesh_cloud(cloud, SurfaceOptions(method=method, watertight=True))
    assert_sound(mesh, tmp_path, watertight=True)
    height = (1 + min_z) * RADIUS
    cap = np.pi * height**2 * (3 * RADIUS - height) / 3
    size = measure(mesh)
    assert size.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3 - cap, rel=0.05)
    assert size.hull_volume is not None
    assert size.volume <= size.hull_volume * (1 + 1e-9)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_holes_that_meet_in_points_are_closed_also_to_who_joins_by_place(share, tmp_path) -> None:
    vertices, faces = grid(12)
    num = 11 * 11
    rng = np.random.default_rng(8)
    y, x = np.divmod(np.arange(num), 11)
    rim = (np.minimum(x, y) == 0) | (np.maximum(x, y) == 10)
    stays = np.tile(rim | (rng.random(num) >= share), 2)
    faces = faces[stays]
    faces = faces[in_large_components(faces, 1.0)]
    vertices[:, 2] = rng.normal(0.0, 0.3, len(vertices))
    vertices, faces, _ = compact(vertices, faces, None)
    assert len(np.unique(vertices, axis=0)) < len(vertices)
    vertices, faces, _ = close_holes(vertices, faces, None)
    assert_sound(TriangleMesh(vertices=vertices, faces=faces), tmp_path, watertight=True)


def test_only_the_largest_piece_is_kept() -> None:
    points = ball_points(3000)
    small = 0.5 * ball_points(800) + [4 * RADIUS, 0, 0]
    normals = np.concatenate([points / RADIUS, ball_points(800) / RADIUS])
    cloud = PointCloud(points=np.concatenate([points, small]), normals=normals)
    mesh = mesh_cloud(cloud, SurfaceOptions(watertight=True))
    assert mesh.vertices[:, 0].max() < 1.1 * RADIUS
    assert measure(mesh).volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.03)
