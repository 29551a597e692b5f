"""Semi-global smoothing against the plain recursion."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.sgm_kernels import best_label, semi_global_sum
from tests.oracles import surface as oracle


def test_semi_global_smoothing_is_hirschmuellers_recursion() -> None:
    rng = np.random.default_rng(0)
    cost = rng.integers(0, 100, (7, 9, 6)).astype(np.uint8)
    grey = rng.uniform(0, 60, (7, 9)).astype(np.float32)
    np.testing.assert_array_equal(
        semi_global_sum(cost, grey, 6, 40, 10.0),
        oracle.semi_global_sum(cost, grey, 6, 40, 10.0),
    )


def test_the_label_is_the_vertex_of_the_parabola() -> None:
    d = np.arange(9.0)
    total = np.rint(50 * (d - 3.3) ** 2).astype(np.uint16)[None, None]
    assert best_label(total)[0, 0] == pytest.approx(3.3, abs=0.01)
    edge = np.arange(9, dtype=np.uint16)[None, None]
    assert best_label(edge)[0, 0] == 0.0
