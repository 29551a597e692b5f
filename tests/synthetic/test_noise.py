"""Random functions of space: variance, smoothness, closed forms of the domes."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.synthetic.noise import (
    domes,
    fractal_noise,
    scattered_directions,
    smooth_noise,
)


def test_smooth_noise_has_mean_zero_and_variance_one() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-50, 50, (40_000, 3))
    # One lattice of 32^3 cells, averaged over a few: its own mean varies by 1 / sqrt(32^3).
    values = np.concatenate([smooth_noise(points, 3.0, rng) for _ in range(4)])
    assert abs(values.mean()) < 0.03
    assert 0.97 < values.std() < 1.03


def test_smooth_noise_has_no_detail_finer_than_its_cells() -> None:
    rng = np.random.default_rng(1)
    line = np.zeros((2001, 3))
    line[:, 0] = np.linspace(0, 10, 2001)
    step = np.abs(np.diff(smooth_noise(line, 2.0, rng)))
    # Slope below 4 per cell of length 1 / 2, over steps of 0.005.
    assert 0.0 < step.max() < 4.0 * 2.0 * 0.005


def test_fractal_noise_keeps_unit_variance_whatever_its_decay() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-50, 50, (40_000, 3))
    for decay in (0.3, 0.9):
        assert fractal_noise(points, 2.0, 4, rng, decay).std() == pytest.approx(1.0, abs=0.05)


def test_the_same_seed_gives_the_same_noise_and_another_seed_another() -> None:
    points = np.random.default_rng(3).normal(size=(50, 3))
    a, b, c = (smooth_noise(points, 2.0, np.random.default_rng(s)) for s in (4, 4, 5))
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.1


def test_scattered_directions_are_unit_vectors_spread_over_the_whole_sphere() -> None:
    d = scattered_directions(500, np.random.default_rng(6))
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0)
    assert np.abs(d.mean(axis=0)).max() < 0.05
    np.testing.assert_allclose((d.T @ d) / 500, np.eye(3) / 3.0, atol=0.05)


def test_a_dome_is_a_hemisphere() -> None:
    x = np.linspace(0, 2, 21)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    height = domes(points, np.zeros((1, 3)), np.array([1.0]))
    np.testing.assert_allclose(height, np.sqrt(np.clip(1 - x**2, 0, None)), atol=1e-12)


def test_the_highest_of_overlapping_domes_counts() -> None:
    centres = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    radii = np.array([1.0, 3.0])
    # Radii are relative to their mean, 2: the large dome is 1.5 high, the small one 0.5.
    height = domes(centres, centres, radii)
    np.testing.assert_allclose(height, [1.5 * np.sqrt(8.0) / 3.0, 1.5])
