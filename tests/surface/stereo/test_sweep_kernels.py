"""The cost volume against the plain correlation."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.stereo.sweep_kernels import MAX_COST, correlation_volume
from semsfm_colmap.types import Array
from tests.oracles import surface as oracle


def smooth_image(shape: tuple[int, int], seed: int) -> Array:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]].astype(float)
    total = np.zeros(shape)
    for _ in range(12):
        a, b = rng.normal(0, 0.35, 2)
        total += np.sin(a * x + b * y + rng.uniform(0, 6))
    return (10.0 * total).astype(np.float32)


def test_the_cost_volume_is_that_of_the_plain_correlation() -> None:
    reference = smooth_image((16, 20), 1)
    base = np.random.default_rng(2).normal(0, 0.3, (16, 20)).astype(np.float32)
    views = np.stack([smooth_image((18, 22), k) for k in (1, 3, 1)])
    B = np.eye(2) + 0.03 * np.random.default_rng(4).normal(size=(3, 2, 2))
    c = np.array([[1.5, 0.1], [-1.0, 0.2], [0.8, 0.0]])
    e = np.array([[0.4, 0.2], [1.0, 0.5], [-0.5, 0.3]])
    noise = np.array([1.0, 0.8, 1.2, 0.9])
    side = np.array([1, 0, 1])
    offsets = np.linspace(-1.0, 1.0, 11)
    cost = correlation_volume(
        reference, base, views, np.ones(views.shape, np.uint8), B, c, e, offsets, 2, noise, side
    )
    for k in (0, 5, 10):
        expected = oracle.correlation_cost(
            reference, base, views, B, c, e, offsets[k], 2, noise, side, MAX_COST
        )
        inner = np.isfinite(expected)
        assert np.abs(cost[..., k][inner] - expected[inner]).max() <= 0.51
        np.testing.assert_array_equal(cost[..., k][~inner], MAX_COST)


def test_what_a_mask_hides_in_every_neighbour_has_no_match() -> None:
    image = smooth_image((16, 20), 1)
    usable = np.zeros((1, 16, 20), dtype=np.uint8)
    zero = np.zeros((1, 2))
    args = (np.zeros((16, 20), np.float32), image[None], usable, np.eye(2)[None], zero, zero)
    cost = correlation_volume(image, *args, np.zeros(3), 2, np.ones(2), np.zeros(1, dtype=np.int64))
    assert (cost == MAX_COST).all()
