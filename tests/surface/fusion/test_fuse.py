"""Votes between depth maps, and the cloud they make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.build import coverage, fuse_depth_maps, mesh
from semsfm_colmap.surface.depth_geometry import camera_normals
from semsfm_colmap.surface.files import DepthMapFolder, write_depth_map
from semsfm_colmap.surface.fusion.consistency import Votes, vote
from semsfm_colmap.surface.fusion.fuse import fuse
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.refine_kernels import local_planes
from semsfm_colmap.types import DepthMap, PointCloud, Reconstruction
from tests.oracles.surface import is_edge_manifold
from tests.surface.scene import (
    HEIGHT,
    RADIUS,
    SCALE,
    WIDTH,
    ball_depth_maps,
    ball_points,
    ball_reconstruction,
    plane_depth,
    turning_cameras,
    write_pictures,
)

ANGLES = list(np.arange(0.0, 360.0, 12.0))
OPTIONS = SurfaceOptions()


@pytest.fixture(scope="module")
def ball(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Reconstruction, list[DepthMap], Path]:
    cameras = turning_cameras(ANGLES)
    folder = tmp_path_factory.mktemp("ball")
    maps = ball_depth_maps(cameras, tuple(f"view_{i:02d}.png" for i in range(len(ANGLES))))
    names = write_pictures(folder, cameras, [np.array(m.depth, dtype=float) for m in maps])
    return ball_reconstruction(cameras, names, 6000), maps, folder


def plane_votes(shift_px: float) -> tuple[Votes, np.ndarray]:
    """A tilted plane seen twice; the second map lies `shift_px` farther along its own ray."""
    cameras = turning_cameras([0.0, 20.0])
    normal = np.array([0.3, 0.2, -1.0])
    normal /= np.linalg.norm(normal)
    depths = [plane_depth(cameras, i, normal) for i in range(2)]
    depths[1] = depths[1] + shift_px / SCALE
    maps = [DepthMap(image_name=str(i), depth=d.astype(np.float32)) for i, d in enumerate(depths)]
    plane = local_planes(maps[0].depth, np.ones((HEIGHT, WIDTH), np.float32), 3, 1.0)
    normals = camera_normals(cameras, 0, np.ones(2), plane)
    inner = normals[:, 20:-20, 20:-20].reshape(3, -1).T @ cameras.cam_from_world[0]
    # the fit of the slope gives up a few percent to be steady at edges
    assert np.degrees(np.arccos(np.clip(inner @ normal, -1, 1))).max() < 2.0
    sizes = np.tile([WIDTH, HEIGHT], (2, 1))
    votes = vote(maps[0], normals, 0, np.array([1]), lambda i: maps[i], cameras, sizes, OPTIONS)
    cosine = -normal @ cameras.viewing_direction[1]
    return votes, np.array([cosine])


def test_two_maps_of_one_plane_agree_and_offer_no_correction() -> None:
    votes, _ = plane_votes(0.0)
    inner = np.s_[30:-30, 40:-40]
    assert (votes.agreeing[inner] == 1).all()
    assert (votes.contradicting == 0).all()
    assert np.abs(SCALE * votes.offset[inner]).max() < 0.02


@pytest.mark.parametrize("shift_px", [-1.0, 1.2])
def test_the_offset_is_the_distance_across_the_surface(shift_px: float) -> None:
    votes, cosine = plane_votes(shift_px)
    inner = np.s_[30:-30, 40:-40]
    # farther along the ray is farther in, hence the minus
    np.testing.assert_allclose(SCALE * votes.offset[inner], -shift_px * cosine[0], rtol=0.05)


def test_a_point_in_front_of_another_surface_is_contradicted_one_behind_is_not() -> None:
    inner = np.s_[30:-30, 40:-40]
    in_front, _ = plane_votes(20.0)
    assert (in_front.agreeing[inner] == 0).all()
    assert (in_front.contradicting[inner] == 1).all()
    behind, _ = plane_votes(-20.0)
    assert (behind.agreeing[inner] == 0).all()
    assert (behind.contradicting[inner] == 0).all()


def test_true_depth_maps_fuse_to_the_ball(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    cloud = fuse(maps, reconstruction, folder, OPTIONS)
    radius = np.linalg.norm(cloud.points, axis=1)
    assert SCALE * np.abs(radius - RADIUS).mean() < 0.1
    assert cloud.normals is not None
    outward = np.einsum("ni,ni->n", cloud.normals, cloud.points) / radius
    assert np.degrees(np.arccos(np.clip(outward, -1, 1))).mean() < 4.0
    assert cloud.sigma is not None
    assert np.median(SCALE * cloud.sigma) < 0.1
    # all around, up to where every image looks along the surface
    assert coverage(cloud, PointCloud(points=ball_points(2000))) > 0.93
    assert cloud.colors is not None
    assert 100 < cloud.colors.mean() < 160


def test_noise_is_averaged_and_sigma_tells_how_much_is_left(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    rng = np.random.default_rng(1)
    noise_px = 0.8
    noisy = [
        replace(m, depth=(m.depth + rng.normal(0, noise_px / SCALE, m.depth.shape)).astype("f4"))
        for m in maps
    ]
    cloud = fuse(noisy, reconstruction, folder, OPTIONS)
    error = SCALE * (np.linalg.norm(cloud.points, axis=1) - RADIUS)
    assert error.std() < 0.4 * noise_px
    assert cloud.sigma is not None
    assert 0.5 * error.std() < np.median(SCALE * cloud.sigma) < 3.0 * error.std()


def test_a_map_that_nobody_confirms_leaves_no_points(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    wrong = replace(maps[4], depth=maps[4].depth - np.float32(0.8))
    cloud = fuse([*maps[:4], wrong, *maps[5:]], reconstruction, folder, OPTIONS)
    assert np.abs(SCALE * (np.linalg.norm(cloud.points, axis=1) - RADIUS)).max() < 3.0


def test_maps_read_from_a_folder_give_the_same_cloud(
    ball: tuple[Reconstruction, list[DepthMap], Path], tmp_path: Path
) -> None:
    reconstruction, maps, folder = ball
    some = maps[:5]
    for depth_map in some:
        write_depth_map(tmp_path, depth_map)
    steps: list[int] = []
    lazy = fuse(
        DepthMapFolder(tmp_path, [m.image_name for m in some]),
        reconstruction,
        folder,
        OPTIONS,
        progress=lambda done, _: steps.append(done),
    )
    np.testing.assert_allclose(lazy.points, fuse(some, reconstruction, folder, OPTIONS).points)
    assert steps == [1, 2, 3, 4, 5]


def test_no_maps_are_an_error_and_empty_maps_an_empty_cloud(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    with pytest.raises(InputError, match="no depth maps"):
        fuse([], reconstruction, folder, OPTIONS)
    empty = [replace(m, depth=np.full_like(m.depth, np.nan)) for m in maps[:3]]
    assert fuse(empty, reconstruction, folder, OPTIONS).points.shape == (0, 3)


def test_where_the_maps_agree_on_nothing_the_sparse_points_are_the_surface(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    empty = [replace(m, depth=np.full_like(m.depth, np.nan)) for m in maps[:3]]
    solution = fuse_depth_maps(empty, reconstruction, folder, OPTIONS)
    assert solution.status == "sparse"
    assert "made from the reconstructed points" in solution.message
    assert solution.value is not None
    assert len(solution.value.points) > 4000


def test_where_the_maps_leave_gaps_that_is_said(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    solution = fuse_depth_maps(maps[:12], reconstruction, folder, OPTIONS)
    assert solution.status == "gaps"
    assert 0.4 < solution.diagnostics["coverage"] < 0.8


def test_the_fused_cloud_becomes_one_sound_mesh(
    ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = ball
    solution = fuse_depth_maps(maps, reconstruction, folder, OPTIONS)
    assert solution.status == "ok"
    assert solution.value is not None
    meshed = mesh(solution.value, OPTIONS)
    assert meshed.value is not None
    assert is_edge_manifold(meshed.value.faces)
    assert meshed.diagnostics["num_components"] == 1
    assert np.abs(SCALE * (np.linalg.norm(meshed.value.vertices, axis=1) - RADIUS)).max() < 1.0


def test_a_cloud_without_a_surface_is_a_failed_solution() -> None:
    failed = mesh(PointCloud(points=np.eye(4, 3), normals=np.eye(4, 3)), OPTIONS)
    assert failed.value is None
    assert not failed.ok
    assert "too few for a mesh" in failed.message
