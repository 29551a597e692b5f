from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.motion.prior import known_tilts
from tests.motion.turning import prior_of


def test_the_range_is_that_of_the_tilts_that_are_known() -> None:
    assert prior_of([3.0, np.nan, 10.0]).range_rad == pytest.approx(np.radians(7.0))


def test_tilts_are_found_by_name_and_unknown_where_nothing_is_said() -> None:
    angle, sigma = known_tilts(prior_of([0.0, np.nan, 10.0]), ["2.tif", "1.tif", "other.tif"])
    np.testing.assert_allclose(np.degrees(angle), [10.0, np.nan, np.nan])
    np.testing.assert_allclose(np.degrees(sigma), [0.2, 0.2, np.nan])
