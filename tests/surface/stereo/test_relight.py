"""A reference in its neighbours' light, against the law that lit it."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.level import Level
from semsfm_colmap.surface.stereo.rasters import Raster
from semsfm_colmap.surface.stereo.relight import (
    GAIN_OVER_SHOWN,
    MAX_GAIN,
    change_of_light,
    gain_of_relief,
    light_of,
    relit,
)
from semsfm_colmap.surface.stereo.views import AffineSweep
from semsfm_colmap.types import Float, Observations, OrthographicCameras, Reconstruction

LIGHT = np.array([0.1, -0.2, 0.7])
SIZE, RADIUS = 120, 50.0


def turned_about_y(angle_deg: Float) -> Float:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(-1, 3, 3)


def lit_ball(light: Float, num_points: int = 2000) -> tuple[Reconstruction, list[Raster]]:
    """A grey ball under `light`, seen by seven images over 60 degrees, with its points."""
    R = turned_about_y(np.linspace(-30.0, 30.0, 7))
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.full(7, RADIUS),
        translation_px=np.full((7, 2), SIZE / 2),
    )
    rng = np.random.default_rng(0)
    points = rng.normal(size=(num_points, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 2] < 0.3]
    facing = np.einsum("mj,nj->mn", cameras.viewing_direction, points) < -0.3
    image, track = np.nonzero(facing)
    observations = Observations(
        track_idx=track,
        image_idx=image,
        keypoint_idx=np.arange(len(track)),
        xy=cameras.project(points[track], image),
        num_tracks=len(points),
        num_images=7,
    )
    model = Reconstruction(
        cameras=cameras,
        points=points,
        observations=observations,
        inlier=np.ones(len(track), dtype=bool),
        image_names=tuple(f"{k}.png" for k in range(7)),
        image_size_px=np.full((7, 2), SIZE),
    )
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2) / RADIUS
    inside = x**2 + y**2 < 0.99
    normal = np.stack([x, y, -np.sqrt(np.where(inside, 1.0 - x**2 - y**2, 0.0))])
    grey = np.where(inside, 100.0 * np.exp(np.tensordot(light, normal, 1)), 5.0)
    raster = Raster(grey=grey.astype(np.float32), usable=inside, noise=1.0)
    return model, [raster] * 7


def test_the_law_is_found_from_the_points() -> None:
    model, rasters = lit_ball(LIGHT)
    found = light_of(model, rasters.__getitem__)
    # what changes with the tilt is known well; along the axis a prior tells it from albedo
    np.testing.assert_allclose(found[[0, 2]], LIGHT[[0, 2]], atol=0.03)
    assert abs(found[1] - LIGHT[1]) < 0.06


def test_a_ball_without_shading_has_no_law() -> None:
    model, rasters = lit_ball(np.zeros(3))
    np.testing.assert_allclose(light_of(model, rasters.__getitem__), 0.0, atol=0.01)


def test_of_a_handful_of_points_no_law_is_taken() -> None:
    model, rasters = lit_ball(LIGHT, num_points=60)
    assert not light_of(model, rasters.__getitem__).any()


@pytest.mark.parametrize("light", [LIGHT, np.array([-0.3, 0.0, 1.0])])
def test_a_relit_place_is_as_bright_as_the_neighbour_shows_it(light: Float) -> None:
    R = turned_about_y(np.array([5.0, 12.0, -20.0]))
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(3, 4, 5))
    normals /= np.linalg.norm(normals, axis=0)
    neighbors = np.array([1, 2])
    change = change_of_light(light, R, 0, neighbors)
    found = relit(np.full((4, 5), 80.0, dtype=np.float32), normals, change, 1.5)
    for j, image in enumerate(neighbors):
        turned = np.einsum("ab,bhw->ahw", R[image] @ R[0].T, normals)
        brighter = np.exp(np.tensordot(light, turned - normals, 1))
        np.testing.assert_allclose(found[j], 80.0 * brighter**1.5, rtol=1e-5)


def test_where_no_normal_is_known_the_grey_stays() -> None:
    grey = np.arange(12, dtype=np.float32).reshape(3, 4)
    found = relit(grey, np.full((3, 3, 4), np.nan), np.ones((2, 3)), 1.5)
    np.testing.assert_array_equal(found, np.stack([grey, grey]))


def test_an_image_from_the_same_side_is_lit_alike() -> None:
    R = turned_about_y(np.array([5.0, 5.0]))
    np.testing.assert_allclose(change_of_light(LIGHT, R, 0, np.array([1])), 0.0, atol=1e-15)


CHANGE = np.array([[0.3, 0.1, 0.2], [-0.2, 0.2, 0.1]])


def rough_normals(noise: float, seed: int) -> Float:
    """(3, 80, 90) of a rough surface: slopes of 0.3 and, with `noise`, what is not there."""
    import cv2

    rng = np.random.default_rng(seed)
    slopes = cv2.GaussianBlur(rng.normal(size=(80, 90, 2)), (0, 0), 2.0).transpose(2, 0, 1)
    slopes *= 0.3 / slopes.std()
    slopes += noise * rng.normal(size=slopes.shape)
    normals = np.concatenate([slopes, -np.ones((1, 80, 90))])
    return np.asarray(normals / np.linalg.norm(normals, axis=0))


def lit_level(true: Float, shown: float) -> Level:
    """Two neighbours straight above the reference whose light is `shown` of what normals tell."""
    grey = np.random.default_rng(8).uniform(60.0, 160.0, true.shape[1:])
    brighter = np.exp(shown * np.tensordot(CHANGE, true, axes=1))
    return Level(
        mean_grey=100.0,
        grey=(grey - 100.0).astype(np.float32),
        usable=np.ones(grey.shape, dtype=bool),
        views=(grey * brighter - 100.0).astype(np.float32),
        view_usable=np.ones((2, *grey.shape), dtype=np.uint8),
        sweep=AffineSweep(B=np.stack([np.eye(2)] * 2), c=np.ones((2, 2)), e=np.zeros((2, 2))),
        noise=np.ones(3),
        contrast=100.0,
        unit=1.0,
        scaling=np.ones(2),
    )


@pytest.mark.parametrize("shown", [0.0, 0.1, 0.2])
def test_the_gain_follows_the_share_of_the_change_that_the_neighbours_show(shown: float) -> None:
    true = rough_normals(0.0, seed=2)
    gain = gain_of_relief(lit_level(true, shown), np.zeros((3, 80, 90)), true, CHANGE)
    assert gain == pytest.approx(GAIN_OVER_SHOWN * shown, rel=0.05, abs=0.02)


def test_the_gain_is_bounded() -> None:
    true = rough_normals(0.0, seed=2)
    level, flat = lit_level(true, 1.0), np.zeros((3, 80, 90))
    assert gain_of_relief(level, flat, true, CHANGE) == MAX_GAIN
    assert gain_of_relief(level, flat, true, -CHANGE) == 0.0


def test_noise_of_the_normals_lowers_the_gain() -> None:
    level, flat = lit_level(rough_normals(0.0, seed=2), 0.2), np.zeros((3, 80, 90))
    as_strong = gain_of_relief(level, flat, rough_normals(0.3, seed=2), CHANGE)
    assert as_strong == pytest.approx(0.5 * GAIN_OVER_SHOWN * 0.2, rel=0.15)
    assert gain_of_relief(level, flat, rough_normals(0.3, seed=3), CHANGE) < 0.05


def test_where_no_depth_is_known_there_is_no_gain() -> None:
    nowhere = np.full((3, 80, 90), np.nan)
    assert gain_of_relief(lit_level(rough_normals(0.0, seed=2), 1.0), nowhere, nowhere, CHANGE) == 0
