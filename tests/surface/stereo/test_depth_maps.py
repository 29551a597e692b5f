"""Depth maps of a ball and a plane whose depth is known."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo import depth_maps
from semsfm_colmap.surface.stereo.depth_maps import sweep_depth_maps
from semsfm_colmap.surface.stereo.views import choose_references
from semsfm_colmap.types import OrthographicCameras, Reconstruction
from tests.pickled import pickled_map
from tests.surface.scene import (
    HEIGHT,
    SCALE,
    WIDTH,
    ball_depth,
    ball_reconstruction,
    plane_depth,
    reconstruction_of,
    turning_cameras,
    write_pictures,
)

OPTIONS = SurfaceOptions(max_depth_map_size_px=WIDTH)
ANGLES = [-12.0, -8.0, -4.0, 0.0, 4.0, 8.0, 12.0]


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> tuple[Reconstruction, Path]:
    cameras = turning_cameras(ANGLES)
    folder = tmp_path_factory.mktemp("ball")
    names = write_pictures(folder, cameras, [ball_depth(cameras, i) for i in range(len(ANGLES))])
    return ball_reconstruction(cameras, names), folder


def test_the_depth_of_a_ball_is_found_to_a_fraction_of_a_pixel(
    ball: tuple[Reconstruction, Path],
) -> None:
    reconstruction, folder = ball
    (found,) = sweep_depth_maps(reconstruction, np.array([3]), folder, None, OPTIONS)
    truth = ball_depth(reconstruction.cameras, 3)
    error = SCALE * (found.depth - truth)
    seen = np.isfinite(truth)
    assert np.isfinite(error).sum() > 0.85 * seen.sum()
    assert np.nanmedian(np.abs(error)) < 0.45
    assert abs(np.nanmedian(error)) < 0.15
    # toward the rim the surface is seen edge-on
    facing = truth < -0.6 * np.nanmax(-truth)
    assert np.nanpercentile(np.abs(error[facing]), 95) < 1.6
    assert found.confidence is not None
    np.testing.assert_array_equal(found.confidence > 0, np.isfinite(found.depth))


def test_the_black_background_has_no_depth(ball: tuple[Reconstruction, Path]) -> None:
    reconstruction, folder = ball
    (found,) = sweep_depth_maps(reconstruction, np.array([3]), folder, None, OPTIONS)
    beside = ~np.isfinite(ball_depth(reconstruction.cameras, 3, 2.2 + 1.5 / SCALE))
    assert np.isfinite(found.depth[beside]).mean() < 0.005


@pytest.mark.parametrize(("aspect", "skew"), [(1.0, 0.0), (1.1, 0.05)])
def test_a_steep_plane_is_found_as_exactly_as_a_flat_one(
    tmp_path: Path, aspect: float, skew: float
) -> None:
    cameras = turning_cameras([-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0], aspect=aspect, skew=skew)
    for k, normal in enumerate([np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.3, -0.74])]):
        folder = tmp_path / str(k)
        depths = [plane_depth(cameras, i, normal) for i in range(7)]
        names = write_pictures(folder, cameras, depths)
        rng = np.random.default_rng(3)
        xy = rng.uniform(-3, 3, (400, 2))
        points = np.column_stack([xy, -(xy @ normal[:2]) / normal[2]])
        reconstruction = reconstruction_of(cameras, names, points)
        (found,) = sweep_depth_maps(reconstruction, np.array([3]), folder, None, OPTIONS)
        inner = np.s_[10:-10, 15:-15]
        error = SCALE * (found.depth - depths[3])[inner]
        assert np.isfinite(error).mean() > 0.9
        assert np.nanmedian(np.abs(error)) < 0.5
        assert abs(np.nanmedian(error)) < 0.1


def test_a_mask_is_kept_out_of_the_depth_map(
    ball: tuple[Reconstruction, Path], tmp_path: Path
) -> None:
    reconstruction, folder = ball
    mask = np.full((HEIGHT, WIDTH), 255, dtype=np.uint8)
    mask[:, : WIDTH // 2] = 0
    assert cv2.imwrite(str(tmp_path / f"{reconstruction.image_names[3]}.png"), mask)
    (found,) = sweep_depth_maps(reconstruction, np.array([3]), folder, tmp_path, OPTIONS)
    assert not np.isfinite(found.depth[:, : WIDTH // 2]).any()
    assert np.isfinite(found.depth[:, WIDTH // 2 :]).sum() > 2500


def test_maps_come_in_order_and_do_not_depend_on_who_computes_them(
    ball: tuple[Reconstruction, Path],
) -> None:
    reconstruction, folder = ball
    with ThreadPoolExecutor(3) as pool:
        maps = list(
            sweep_depth_maps(
                reconstruction,
                np.arange(7),
                folder,
                None,
                OPTIONS,
                parallel_map=pool.map,
                num_at_a_time=3,
            )
        )
    assert [m.image_name for m in maps] == list(reconstruction.image_names)
    (elsewhere,) = sweep_depth_maps(
        reconstruction, np.array([5]), folder, None, OPTIONS, parallel_map=pickled_map
    )
    np.testing.assert_array_equal(maps[5].depth, elsewhere.depth)
    np.testing.assert_array_equal(maps[5].sigma, elsewhere.sigma)


def test_a_map_is_made_when_it_is_asked_for(
    ball: tuple[Reconstruction, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    monkeypatch.setattr(
        depth_maps, "sweep_depth_map", lambda _, reference, *rest: made.append(reference)
    )
    maps = sweep_depth_maps(ball[0], np.arange(7), ball[1], None, OPTIONS)
    next(maps)
    assert made == [0]


def test_maps_of_few_images_are_smaller_when_that_is_asked_for(
    ball: tuple[Reconstruction, Path],
) -> None:
    reconstruction, folder = ball
    options = SurfaceOptions(max_depth_map_size_px=80)
    references = choose_references(reconstruction.cameras, 2)
    maps = list(sweep_depth_maps(reconstruction, references, folder, None, options))
    assert [m.image_name for m in maps] == ["view_00.png", "view_06.png"]
    assert maps[0].depth.shape == (60, 80)


def test_images_without_parallax_have_no_depth(tmp_path: Path) -> None:
    cameras = turning_cameras([0.0, 0.5, 1.0])
    names = write_pictures(tmp_path, cameras, [ball_depth(cameras, i) for i in range(3)])
    reconstruction = ball_reconstruction(cameras, names)
    for found in sweep_depth_maps(reconstruction, np.arange(3), tmp_path, None, OPTIONS):
        assert found.depth.shape == (HEIGHT, WIDTH)
        assert np.isnan(found.depth).all()


def test_the_unit_and_the_place_of_the_world_do_not_matter(
    ball: tuple[Reconstruction, Path],
) -> None:
    reconstruction, folder = ball
    cameras = reconstruction.cameras
    # the same images: X' = 64 X + shift
    shift = np.array([100.0, -50.0, 30.0])
    moved = OrthographicCameras(
        cam_from_world=cameras.cam_from_world,
        scale_px_per_unit=cameras.scale_px_per_unit / 64.0,
        translation_px=cameras.translation_px - cameras.projection @ shift / 64.0,
    )
    other = Reconstruction(
        image_names=reconstruction.image_names,
        image_size_px=reconstruction.image_size_px,
        cameras=moved,
        points=64.0 * reconstruction.points + shift,
        observations=reconstruction.observations,
        inlier=reconstruction.inlier,
    )
    (a,) = sweep_depth_maps(reconstruction, np.array([3]), folder, None, OPTIONS)
    (b,) = sweep_depth_maps(other, np.array([3]), folder, None, OPTIONS)
    back = (b.depth - shift @ cameras.viewing_direction[3]) / 64.0
    both = np.isfinite(a.depth) & np.isfinite(back)
    assert both.sum() > 0.97 * np.isfinite(a.depth).sum()
    assert np.median(np.abs(SCALE * (a.depth - back)[both])) < 0.01
