"""The law of the shading, from greys that obey it and greys that do not."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.surface.shading import Shading, fit_shading
from semsfm_colmap.types import Array, Float

TRUE = Shading(gradient=np.array([0.2, -0.4, 0.7]), gain=np.array([0.9, 1.1, 1.0, 1.2, 0.8]))


def seen(
    num: int, rng: np.random.Generator, spread: float, axes: Float | None = None
) -> tuple[Float, Array, Float, Float]:
    """Greys, weights, normals and log albedos of places on a ball, in five views of it."""
    axes = np.array([[0.0, 1, 0], [0.3, 1, 0.2]]) if axes is None else axes
    turn = np.linspace(-0.9, 0.9, 5)[:, None] * axes[np.arange(5) % len(axes)]
    normal = rng.normal(size=(num, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normals = np.einsum("mij,vj->mvi", rotation_from_vector(turn), normal)
    weight = np.maximum(-normals[..., 2], 0.0).astype(np.float32)
    albedo = spread * rng.normal(size=num)
    grey = 120 * np.stack([TRUE.factor(i, normals[i]) for i in range(5)]) * np.exp(albedo)
    return grey, weight, normals, albedo


def test_law_and_gains_are_recovered_from_greys_that_obey_them() -> None:
    grey, weight, normals, _ = seen(4000, np.random.default_rng(0), 0.2)
    grey *= np.exp(np.random.default_rng(1).normal(0, 0.1, grey.shape))
    found = fit_shading(grey, weight, normals)
    np.testing.assert_allclose(found.gradient, TRUE.gradient, atol=0.02)
    ratio = found.gain / TRUE.gain
    np.testing.assert_allclose(ratio / ratio.mean(), 1.0, atol=0.01)


def test_the_factors_of_all_that_is_seen_have_the_geometric_mean_one() -> None:
    grey, weight, normals, _ = seen(500, np.random.default_rng(0), 0.2)
    for law in (normals, None):
        found = fit_shading(grey, weight, law)
        log = np.log([found.factor(i, normals[i]) for i in range(5)])
        assert abs(np.average(log, weights=weight)) < 1e-9


def test_it_is_the_least_squares_solution_with_every_albedo_an_unknown() -> None:
    rng = np.random.default_rng(4)
    grey, weight, normals, _ = seen(40, rng, 0.3)
    grey *= np.exp(rng.normal(0, 0.2, grey.shape))
    found = fit_shading(grey, weight, normals)
    image, place = np.nonzero(weight)
    rows = np.zeros((len(image) + 43, 3 + 5 + 40))
    rows[: len(image), :3] = normals[image, place]
    rows[np.arange(len(image)), 3 + image] = 1.0
    rows[np.arange(len(image)), 8 + place] = 1.0
    rows[len(image) + np.arange(40), 8 + np.arange(40)] = 1.0
    rows[len(image) + 40 + np.arange(3), np.arange(3)] = 1.0
    root = np.sqrt(np.concatenate([weight[image, place], np.full(40, 0.3), np.full(3, 0.02)]))
    right = np.concatenate([np.log(grey[image, place]), np.zeros(43)])
    plain = np.linalg.lstsq(rows * root[:, None], right * root)[0]
    np.testing.assert_allclose(found.gradient, plain[:3], atol=1e-6)
    np.testing.assert_allclose(np.diff(np.log(found.gain)), np.diff(plain[3:8]), atol=1e-6)


def test_along_the_one_axis_of_a_turn_the_albedo_does_not_follow_the_normal() -> None:
    # what a turn about y cannot tell from albedo is shading
    grey, weight, normals, albedo = seen(
        4000, np.random.default_rng(2), 0.1, np.array([[0.0, 1, 0]])
    )
    found = fit_shading(grey, weight, normals)
    np.testing.assert_allclose(found.gradient, TRUE.gradient, atol=0.02)
    left = np.stack([grey[i] / found.factor(i, normals[i]) for i in range(5)])
    recovered = np.log((weight * left).sum(axis=0)[weight.any(axis=0)])
    assert abs(np.corrcoef(recovered, normals[0, weight.any(axis=0), 1])[0, 1]) < 0.2
    assert np.std(albedo) > 0.05


def test_gains_alone_are_recovered_and_an_image_that_sees_nothing_keeps_one() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(60, 200, 500)
    gain = np.array([0.8, 1.0, 1.3, 1.1])
    weight = (rng.random((4, 500)) < 0.6).astype(np.float32)
    weight[3] = 0
    found = fit_shading(truth * gain[:, None] + rng.normal(0, 2, (4, 500)), weight, None)
    assert found.gain[3] == 1.0
    np.testing.assert_array_equal(found.gradient, 0.0)
    ratio = found.gain[:3] / gain[:3]
    np.testing.assert_allclose(ratio / ratio.mean(), 1.0, rtol=0.03)


def test_a_mesh_that_no_image_sees_has_no_shading() -> None:
    found = fit_shading(np.full((2, 3), 50.0), np.zeros((2, 3), np.float32), np.zeros((2, 3, 3)))
    np.testing.assert_array_equal(found.gain, 1.0)
    np.testing.assert_array_equal(found.gradient, 0.0)


def test_black_pixels_have_no_logarithm_and_do_no_harm() -> None:
    grey, weight, normals, _ = seen(200, np.random.default_rng(0), 0.2)
    grey[:, :5] = 0.0
    found = fit_shading(grey, weight, normals)
    assert np.isfinite(found.gradient).all()
    assert np.isfinite(found.gain).all()


def test_a_plane_has_no_gradient_that_the_gains_could_not_explain() -> None:
    rng = np.random.default_rng(5)
    angle = np.radians([-20.0, -5.0, 10.0, 25.0])
    normal = np.stack([np.sin(angle), np.zeros(4), -np.cos(angle)], axis=1)
    normals = np.repeat(normal[:, None], 300, axis=1)
    grey = np.exp(rng.normal(4.0, 0.3, 300) + rng.normal(0.0, 0.1, (4, 300)))
    found = fit_shading(grey, np.ones((4, 300)), normals)
    np.testing.assert_allclose(found.gradient, 0.0, atol=1e-6)
