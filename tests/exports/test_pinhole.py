from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.exports.pinhole import pinhole_views
from tests.exports.ball_project import ball, image_names


def test_equal_distances_keep_the_projections() -> None:
    made = ball(image_names(False))
    near = pinhole_views(made, 60_000.0, equal_distance=True)
    assert np.ptp(near.translation[:, 2]) < 1e-9 * near.translation[0, 2]
    assert np.ptp(near.focal_px[:, 0]) > 10.0
    shared = pinhole_views(made, 60_000.0)
    assert np.ptp(shared.focal_px) == 0.0
    assert near.max_deviation_px == pytest.approx(shared.max_deviation_px, rel=0.01)
