"""What depth maps of a plane say about each other."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.depth_geometry import camera_normals
from semsfm_colmap.surface.fusion.consistency import Votes, vote
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.types import DepthMap
from tests.surface.scene import (
    HEIGHT,
    SCALE,
    WIDTH,
    plane_depth,
    turning_cameras,
)

OPTIONS = SurfaceOptions()


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
