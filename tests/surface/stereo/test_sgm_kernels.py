"""Semi-global smoothing against the plain recursion."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.sgm_kernels import (
    best_label,
    semi_global_sum,
    surface_jumps,
)
from tests.oracles import surface as oracle

FLAT = np.zeros((3, 7, 9), dtype=np.float32)


@pytest.mark.parametrize("rough", [0.0, 2.0, 30.0])
def test_semi_global_smoothing_is_hirschmuellers_recursion_over_a_base(rough: float) -> None:
    rng = np.random.default_rng(0)
    cost = rng.integers(0, 100, (7, 9, 6)).astype(np.uint8)
    grey = rng.uniform(0, 60, (7, 9)).astype(np.float32)
    base = rng.normal(0.0, rough, (3, 7, 9)).astype(np.float32)
    np.testing.assert_array_equal(
        semi_global_sum(cost, grey, surface_jumps(base, 1.3), 6, 40, 10.0),
        oracle.semi_global_sum(cost, grey, base, 1.3, 6, 40, 10.0),
    )


def test_a_slope_is_no_jump_and_a_ledge_is_one() -> None:
    y, x = np.mgrid[0:7, 0:9].astype(np.float32)
    rise = 1.5 * x - 0.7 * y
    base = np.stack([rise + 8.0 * (x > 4), np.full_like(x, 1.5), np.full_like(x, -0.7)])
    jumps = surface_jumps(base, 2.0)
    ledge = np.zeros((7, 9), dtype=bool)
    ledge[:, 5] = True
    np.testing.assert_array_equal(jumps[0], 4 * ledge)
    np.testing.assert_array_equal(jumps[1, 1:], 4 * ledge[1:])
    assert not jumps[2].any()
    np.testing.assert_array_equal(jumps[3, 1:], -4 * np.roll(ledge, -1, axis=1)[1:])
    assert not surface_jumps(FLAT, 2.0).any()


def test_a_flaw_of_the_base_pulls_nothing_beside_it() -> None:
    """A plane of no texture at all, but for one column, over a base with a ledge in it."""
    H, W, D = 9, 21, 8
    base = np.zeros((3, H, W), dtype=np.float32)
    base[0, :, 12:] = 3.0  # by three labels of the plane at label 5 from the base on the left
    cost = np.full((H, W, D), 50, dtype=np.uint8)
    cost[:, 4, 5] = 0
    grey = np.zeros((H, W), dtype=np.float32)
    total = semi_global_sum(cost, grey, surface_jumps(base, 1.0), 6, 40, 9.0)
    depth = base[0] + best_label(total, D)
    np.testing.assert_allclose(depth, 5.0, atol=0.5)


def test_the_label_is_the_vertex_of_the_parabola() -> None:
    d = np.arange(9.0)
    total = np.rint(50 * (d - 3.3) ** 2).astype(np.uint16)[None, None]
    assert best_label(total, 9)[0, 0] == pytest.approx(3.3, abs=0.01)
    edge = np.arange(9, dtype=np.uint16)[None, None]
    assert best_label(edge, 9)[0, 0] == 0.0
    assert best_label(9 - edge, 9)[0, 0] == 8.0
    # what pads a pixel's costs is no label
    assert best_label(9 - edge, 5)[0, 0] == 4.0
