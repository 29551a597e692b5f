"""The cloud that the depth maps of a ball make."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.files import DepthMapFolder, write_depth_map
from semsfm_colmap.surface.fusion.fuse import fuse
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, DepthMap, Reconstruction
from tests.pickled import pickled_map
from tests.surface.scene import (
    RADIUS,
    SCALE,
)

OPTIONS = SurfaceOptions()


def test_noise_is_averaged_and_sigma_tells_how_much_is_left(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    rng = np.random.default_rng(1)
    noise_px = 0.8

    def noise(shape: tuple[int, ...]) -> Array:
        # neighbours share windows, hence noise
        white = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 2.0)
        return np.asarray(noise_px / SCALE * white / white.std())

    noisy = [replace(m, depth=(m.depth + noise(m.depth.shape)).astype("f4")) for m in maps]
    cloud = fuse(noisy, reconstruction, folder, OPTIONS)
    error = SCALE * (np.linalg.norm(cloud.points, axis=1) - RADIUS)
    assert error.std() < 0.5 * noise_px
    assert cloud.sigma is not None
    assert 0.5 * error.std() < np.median(SCALE * cloud.sigma) < 3.0 * error.std()


def test_windows_that_say_nothing_leave_what_the_other_maps_say(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    blind = [replace(m, sigma=np.full(m.depth.shape, np.inf, dtype=np.float32)) for m in maps]
    cloud = fuse(blind, reconstruction, folder, OPTIONS)
    assert cloud.sigma is not None
    assert np.isfinite(cloud.sigma).all()
    assert 1.0 < np.median(SCALE * cloud.sigma) < 10.0


def test_a_map_that_nobody_confirms_leaves_no_points(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    wrong = replace(maps[4], depth=maps[4].depth - np.float32(0.8))
    cloud = fuse([*maps[:4], wrong, *maps[5:]], reconstruction, folder, OPTIONS)
    assert np.abs(SCALE * (np.linalg.norm(cloud.points, axis=1) - RADIUS)).max() < 3.0


def test_what_no_other_map_can_judge_stands_on_its_own_correlation(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    seen = np.isfinite(maps[4].depth)
    share = {}
    for name, confidence in (("sure", 0.9), ("unsure", 0.3)):
        lone = replace(maps[4], confidence=np.where(seen, confidence, 0.0).astype("f4"))
        cloud = fuse([lone], reconstruction, folder, OPTIONS)
        share[name] = len(cloud.points)
        if len(cloud.points):
            assert np.abs(SCALE * (np.linalg.norm(cloud.points, axis=1) - RADIUS)).max() < 1.0
            # it is not credited with an accuracy that nobody has checked
            assert cloud.sigma is not None
            np.testing.assert_allclose(SCALE * cloud.sigma, 0.5 * OPTIONS.consistency_px, rtol=0.05)
    assert share["sure"] > 1000
    assert share["unsure"] == 0


def test_maps_read_from_a_folder_give_the_same_cloud(
    round_ball: tuple[Reconstruction, list[DepthMap], Path], tmp_path: Path
) -> None:
    reconstruction, maps, folder = round_ball
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
    elsewhere = fuse(
        DepthMapFolder(tmp_path, [m.image_name for m in some]),
        reconstruction,
        folder,
        OPTIONS,
        parallel_map=pickled_map,
    )
    np.testing.assert_array_equal(elsewhere.points, lazy.points)
    np.testing.assert_array_equal(elsewhere.sigma, lazy.sigma)
    assert steps == [1, 2, 3, 4, 5]


def test_no_maps_are_an_error_and_empty_maps_an_empty_cloud(
    round_ball: tuple[Reconstruction, list[DepthMap], Path],
) -> None:
    reconstruction, maps, folder = round_ball
    with pytest.raises(InputError, match="no depth maps"):
        fuse([], reconstruction, folder, OPTIONS)
    empty = [replace(m, depth=np.full_like(m.depth, np.nan)) for m in maps[:3]]
    assert fuse(empty, reconstruction, folder, OPTIONS).points.shape == (0, 3)
