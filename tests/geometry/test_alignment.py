"""Similarities of points, rotations of the world, alignment of orthographic cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.alignment import (
    Similarity,
    align_cameras,
    align_cameras_both_hands,
    align_rotations,
    depth_reversed_cameras,
    fit_similarity,
)
from semsfm_colmap.geometry.rotations import MIRROR_Z, rotation_angle, rotation_from_vector
from semsfm_colmap.types import Float, OrthographicCameras

RNG = np.random.default_rng


def random_rotations(rng: np.random.Generator, n: int) -> Float:
    return rotation_from_vector(rng.normal(size=(n, 3)) * 1.5)


def random_cameras(rng: np.random.Generator, n: int, **kwargs: float) -> OrthographicCameras:
    return OrthographicCameras(
        cam_from_world=random_rotations(rng, n),
        scale_px_per_unit=rng.uniform(150.0, 250.0, n),
        translation_px=rng.uniform(200.0, 400.0, (n, 2)),
        **kwargs,
    )


def moved(cameras: OrthographicCameras, world: Similarity) -> OrthographicCameras:
    """The same cameras for points ``world.apply(X)`` instead of X."""
    back = world.inverse
    shift = np.einsum("mij,j->mi", cameras.projection, back.shift)
    return OrthographicCameras(
        cam_from_world=cameras.cam_from_world @ back.rotation,
        scale_px_per_unit=cameras.scale_px_per_unit * back.scale,
        translation_px=cameras.translation_px + shift,
        aspect=cameras.aspect,
        skew=cameras.skew,
    )


@pytest.fixture
def world() -> Similarity:
    rotation = rotation_from_vector(np.array([0.4, -1.2, 2.0]))
    return Similarity(rotation=rotation, scale=13.0, shift=np.array([3.0, -5.0, 8.0]))


def test_a_similarity_is_recovered_exactly_from_exact_points(world: Similarity) -> None:
    x = RNG(0).normal(size=(20, 3))
    found = fit_similarity(x, world.apply(x))
    np.testing.assert_allclose(found.rotation, world.rotation, atol=1e-12)
    np.testing.assert_allclose(found.shift, world.shift, atol=1e-10)
    assert found.scale == pytest.approx(13.0, rel=1e-12)


def test_the_inverse_undoes_a_similarity(world: Similarity) -> None:
    x = RNG(1).normal(size=(7, 3))
    np.testing.assert_allclose(world.inverse.apply(world.apply(x)), x, atol=1e-12)


def test_a_reflection_is_found_when_allowed_and_never_otherwise(world: Similarity) -> None:
    x = RNG(2).normal(size=(30, 3))
    y = world.apply(x @ MIRROR_Z)
    proper = fit_similarity(x, y)
    free = fit_similarity(x, y, with_reflection=True)
    assert np.linalg.det(proper.rotation) == pytest.approx(1.0)
    assert np.linalg.det(free.rotation) == pytest.approx(-1.0)
    np.testing.assert_allclose(free.apply(x), y, atol=1e-10)
    assert np.abs(proper.apply(x) - y).max() > 1.0


def test_allowing_a_reflection_does_not_change_a_proper_fit(world: Similarity) -> None:
    rng = RNG(3)
    x = rng.normal(size=(30, 3))
    y = world.apply(x) + 0.05 * rng.normal(size=x.shape)
    a, b = fit_similarity(x, y), fit_similarity(x, y, with_reflection=True)
    np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-12)


def test_coplanar_points_still_give_the_rotation(world: Similarity) -> None:
    x = RNG(4).normal(size=(10, 3)) * [1.0, 1.0, 0.0]
    found = fit_similarity(x, world.apply(x))
    np.testing.assert_allclose(found.rotation, world.rotation, atol=1e-12)


def test_weight_zero_takes_a_point_out(world: Similarity) -> None:
    x = RNG(5).normal(size=(12, 3))
    y = world.apply(x)
    y[0] += 1e3
    weights = np.ones(12)
    weights[0] = 0.0
    found = fit_similarity(x, y, weights=weights)
    np.testing.assert_allclose(found.rotation, world.rotation, atol=1e-12)
    assert np.abs(fit_similarity(x, y).shift - world.shift).max() > 1.0


@pytest.mark.parametrize("mirror", [np.eye(3), MIRROR_Z], ids=["same hand", "mirrored"])
def test_no_other_similarity_nearby_fits_noisy_points_better(
    world: Similarity, mirror: Float
) -> None:
    rng = RNG(6)
    x = rng.normal(size=(15, 3))
    y = world.apply(x @ mirror) + rng.normal(size=x.shape)
    best = fit_similarity(x, y)

    def cost(s: Similarity) -> float:
        return float(np.sum((s.apply(x) - y) ** 2))

    for _ in range(50):
        step = 1e-3 * rng.normal(size=7)
        other = Similarity(
            rotation=rotation_from_vector(step[:3]) @ best.rotation,
            scale=best.scale * (1 + step[3]),
            shift=best.shift + step[4:],
        )
        assert cost(other) > cost(best)


def test_points_on_a_line_have_no_unique_rotation() -> None:
    x = np.linspace(0, 1, 9)[:, None] * [[1.0, 2.0, 3.0]]
    with pytest.raises(InputError, match="line"):
        fit_similarity(x, x)


def test_two_points_are_too_few() -> None:
    with pytest.raises(InputError, match="at least 3"):
        fit_similarity(np.eye(3)[:2], np.eye(3)[:2])


def test_shapes_that_do_not_match_are_misuse() -> None:
    with pytest.raises(UsageError, match=r"\(N, 3\)"):
        fit_similarity(np.zeros((4, 3)), np.zeros((5, 3)))


def test_scale_can_be_held_at_one(world: Similarity) -> None:
    x = RNG(7).normal(size=(9, 3))
    assert fit_similarity(x, world.apply(x), with_scale=False).scale == 1.0


def test_the_world_rotation_between_two_sets_of_rotations_is_exact() -> None:
    rng = RNG(8)
    R_true, Q = random_rotations(rng, 6), random_rotations(rng, 1)[0]
    np.testing.assert_allclose(align_rotations(R_true @ Q.T, R_true), Q, atol=1e-12)


def test_the_world_rotation_averages_isotropic_noise() -> None:
    rng = RNG(9)
    R_true, Q = random_rotations(rng, 400), random_rotations(rng, 1)[0]
    noise = rotation_from_vector(np.radians(1.0) * rng.normal(size=(400, 3)))
    found = align_rotations(noise @ R_true @ Q.T, R_true)
    error = np.degrees(rotation_angle(found @ Q.T))
    assert 0.0 < error < 4 * np.sqrt(3) / np.sqrt(400)


def test_aligned_cameras_project_the_same_points_to_the_same_pixels(world: Similarity) -> None:
    rng = RNG(10)
    true = random_cameras(rng, 9, aspect=1.02, skew=0.01)
    estimated = moved(true, world)
    x = rng.normal(size=(50, 3))
    found = align_cameras(estimated, true)
    back = found.true_from_estimated.apply(world.apply(x))
    np.testing.assert_allclose(back, x, atol=1e-10)
    for i in range(9):
        idx = np.full(50, i)
        np.testing.assert_allclose(
            true.project(back, idx), estimated.project(world.apply(x), idx), atol=1e-8
        )
    np.testing.assert_allclose(found.rotation_error_rad, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.translation_error_px, 0.0, atol=1e-8)
    np.testing.assert_allclose(found.scale_ratio, 1.0, atol=1e-12)


def test_the_mirrored_cameras_align_only_when_mirrored_back(world: Similarity) -> None:
    rng = RNG(11)
    true = random_cameras(rng, 9)
    estimated = depth_reversed_cameras(moved(true, world))
    as_given, reverse = align_cameras_both_hands(estimated, true)
    assert as_given.rotation_rms_rad > 0.3
    assert reverse.rotation_rms_rad < 1e-12
    x = rng.normal(size=(20, 3))
    seen = world.apply(x) @ MIRROR_Z
    np.testing.assert_allclose(reverse.true_from_estimated.apply(seen), x, atol=1e-10)
    assert np.linalg.det(reverse.true_from_estimated.rotation) == pytest.approx(-1.0)


def test_both_hands_of_a_twin_swap(world: Similarity) -> None:
    true = random_cameras(RNG(12), 5)
    estimated = moved(true, world)
    a, b = align_cameras_both_hands(estimated, true)
    c, d = align_cameras_both_hands(depth_reversed_cameras(estimated), true)
    np.testing.assert_allclose(a.rotation_error_rad, d.rotation_error_rad, atol=1e-12)
    np.testing.assert_allclose(b.rotation_error_rad, c.rotation_error_rad, atol=1e-12)


def test_a_shift_along_the_only_viewing_direction_is_left_at_zero() -> None:
    true = OrthographicCameras(
        cam_from_world=np.eye(3)[None],
        scale_px_per_unit=np.array([100.0]),
        translation_px=np.array([[50.0, 60.0]]),
    )
    estimated = moved(
        true, Similarity(rotation=np.eye(3), scale=1.0, shift=np.array([1.0, 2.0, 7.0]))
    )
    found = align_cameras(estimated, true)
    np.testing.assert_allclose(found.true_from_estimated.shift, [-1.0, -2.0, 0.0], atol=1e-12)


def test_cameras_in_different_numbers_are_misuse() -> None:
    rng = RNG(13)
    with pytest.raises(UsageError, match="same number"):
        align_cameras(random_cameras(rng, 3), random_cameras(rng, 4))


def test_noisy_cameras_align_the_same_wherever_their_world_has_its_origin() -> None:
    rng = RNG(14)
    true = random_cameras(rng, 9)
    noise = rotation_from_vector(0.01 * rng.normal(size=(9, 3)))
    noisy = replace(
        true,
        cam_from_world=noise @ true.cam_from_world,
        translation_px=true.translation_px + rng.normal(size=(9, 2)),
    )
    far = Similarity(rotation=random_rotations(rng, 1)[0], scale=3.0, shift=np.full(3, 40.0))
    x = rng.normal(size=(20, 3))
    here, there = align_cameras(noisy, true), align_cameras(moved(noisy, far), true)
    np.testing.assert_allclose(
        there.true_from_estimated.apply(far.apply(x)), here.true_from_estimated.apply(x), atol=1e-9
    )
    np.testing.assert_allclose(there.translation_error_px, here.translation_error_px, atol=1e-8)
    assert 0.3 < here.translation_error_px.std() < 2.0
