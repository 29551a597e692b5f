"""Coordinates of one model are found again in another one."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.segmentation.world import NUM_IMAGES, carry, world_of
from semsfm_colmap.types import OrthographicCameras
from tests.segmentation import shapes

ANGLES = np.arange(0.0, 60.0, 5.0)
NAMES = tuple(f"{k:02d}.png" for k in range(len(ANGLES)))
SIZE = np.tile([shapes.WIDTH, shapes.HEIGHT], (len(ANGLES), 1))
CAMERAS = shapes.cameras_about("y", ANGLES)
POINTS = np.random.default_rng(0).uniform(-1, 1, (50, 3))
MIRROR = np.diag([1.0, 1.0, -1.0])


def other_world(*, scale=1.0, mirrored=False, noise=0.0) -> OrthographicCameras:
    """The same images in a world that is turned, shifted and scaled, and perhaps reversed."""
    rng = np.random.default_rng(1)
    Q, c = rotation_from_vector(np.array([0.4, 1.0, -0.5])), np.array([0.3, -0.2, 0.8])
    R = CAMERAS.cam_from_world
    seen = np.einsum("mij,j->mi", CAMERAS.projection, c)
    if mirrored:
        R = MIRROR @ R @ MIRROR
        seen = np.einsum("mij,j->mi", CAMERAS.projection, MIRROR @ c)
    jitter = rotation_from_vector(noise * rng.normal(size=(len(R), 3)))
    return replace(
        CAMERAS,
        cam_from_world=jitter @ R @ Q,
        scale_px_per_unit=CAMERAS.scale_px_per_unit / scale,
        translation_px=CAMERAS.translation_px + seen,
    )


def pixels(cameras, points):
    return np.array([cameras.project(points, np.full(len(points), i)) for i in range(len(cameras))])


@pytest.mark.parametrize("scale", [1.0, 0.05, 400.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_point_carried_over_is_seen_where_it_was(scale, mirrored):
    other = other_world(scale=scale, mirrored=mirrored)
    found = carry(world_of(NAMES, CAMERAS), NAMES, other, SIZE)
    assert found.value is not None
    assert (np.linalg.det(found.value.rotation) < 0) == mirrored
    there = found.value.apply(POINTS)
    np.testing.assert_allclose(pixels(other, there), pixels(CAMERAS, POINTS), atol=1e-8)


def test_the_same_model_has_the_same_world_and_another_one_has_another():
    assert world_of(NAMES, CAMERAS) == world_of(NAMES, replace(CAMERAS))
    assert world_of(NAMES, CAMERAS) != world_of(NAMES, other_world())
    assert len(world_of(NAMES, CAMERAS)) == NUM_IMAGES
    assert len(world_of(NAMES[:3], CAMERAS.select(np.arange(3)))) == 3


@pytest.mark.parametrize(("noise", "fits"), [(0.003, True), (0.1, False)])
def test_cameras_that_disagree_are_refused(noise, fits):
    found = carry(world_of(NAMES, CAMERAS), NAMES, other_world(noise=noise), SIZE)
    assert found.ok == fits
    assert "the cameras of 8 images agree to" in found.message
    if found.value is not None:
        off = pixels(other_world(noise=noise), found.value.apply(POINTS)) - pixels(CAMERAS, POINTS)
        assert np.sqrt(np.mean(off**2)) < 0.02 * shapes.WIDTH


def test_images_that_are_cropped_elsewhere_are_refused():
    cropped = replace(
        CAMERAS, translation_px=CAMERAS.translation_px + [30.0, 30.0] * (ANGLES[:, None] > 25)
    )
    found = carry(world_of(NAMES, CAMERAS), NAMES, cropped, SIZE)
    assert found.value is None
    assert "% of the image" in found.message


@pytest.mark.parametrize("num", [0, 1])
def test_too_few_common_images_are_named(num):
    names = tuple(f"new_{name}" for name in NAMES[num:])
    found = carry(world_of(NAMES, CAMERAS), NAMES[:num] + names, CAMERAS, SIZE)
    assert found.value is None
    assert f"{num} of its 8 images are in the model" in found.message


def test_images_of_one_direction_leave_the_depth_open():
    flat = shapes.cameras_about("y", np.zeros(4))
    assert carry(world_of(NAMES[:4], flat), NAMES[:4], flat, SIZE[:4]).value is None
