"""Local optimisation of hyperplanes, against the slow one."""

import numpy as np

from semsfm_colmap.matching.ransac_kernels import optimise_hyperplanes
from tests.oracles.hyperplanes import optimise_hyperplane

THRESHOLDS, LIMIT = np.array([6.0, 4.0, 2.0, 2.0]), 4.0


def contaminated(rng, num):
    """Points near a hyperplane, a third of them anywhere; the plane's normal and offset."""
    normal = rng.normal(size=4)
    normal /= np.linalg.norm(normal)
    points = rng.uniform(-300.0, 300.0, (num, 4))
    near = points[num // 3 :]
    near -= ((near @ normal + 20.0) + rng.normal(scale=0.5, size=len(near)))[:, None] * normal
    return points - points.mean(axis=0), normal


def test_samples_are_optimised_as_one_by_one_and_by_singular_vectors():
    rng = np.random.default_rng(0)
    points, truth = contaminated(rng, 300)
    normals = truth + rng.normal(scale=0.01, size=(6, 4))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = -np.median(points @ normals.T, axis=0)
    expected = [
        optimise_hyperplane(points, n, e, THRESHOLDS, LIMIT)
        for n, e in zip(normals.copy(), offsets.copy(), strict=True)
    ]
    score = optimise_hyperplanes(points, normals, offsets, THRESHOLDS, LIMIT)
    for n, e, s, (n0, e0, s0) in zip(normals, offsets, score, expected, strict=True):
        side = np.sign(n @ n0)
        np.testing.assert_allclose(side * n, n0, atol=1e-9)
        np.testing.assert_allclose(side * e, e0, atol=1e-7)
        np.testing.assert_allclose(s, s0, rtol=1e-8)
    assert np.abs(normals[np.argmin(score)] @ truth) > 1.0 - 1e-6


def test_a_sample_with_four_points_near_it_stays_as_it_is():
    points = np.concatenate([np.zeros((4, 4)), np.full((50, 4), 100.0)])
    normals, offsets = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros(1)
    score = optimise_hyperplanes(points, normals, offsets, THRESHOLDS, LIMIT)
    assert normals.tolist() == [[1.0, 0.0, 0.0, 0.0]]
    assert offsets.tolist() == [0.0]
    assert score.tolist() == [50 * LIMIT]
