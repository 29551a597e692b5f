from __future__ import annotations

from math import radians

import numpy as np
import pytest

from semsfm_colmap.motion.check import check_tilt
from semsfm_colmap.motion.combine import combine_tilt
from tests.motion.turning import TILTS, cameras, prior_of


@pytest.mark.parametrize("factor", [0.96, 1.0, 1.04])
def test_angles_are_stretched_toward_the_known_ones_by_their_weight(factor: float) -> None:
    tilts = np.linspace(0, 10, 3)
    for sigma, low, high in ((1e-4, 0.999, 1.0), (0.2, 0.5, 0.7), (50.0, 0.0, 1e-3)):
        prior = prior_of(tilts / factor, sigma)
        check = check_tilt(prior, prior.image_names, cameras(tilts))
        combined = combine_tilt(check, radians(10.0), radians(0.05))
        assert low <= combined.weight <= high
        assert combined.stretch == pytest.approx(factor**-combined.weight)
        images = np.hypot(0.05 / 10, 0.0004 * 9000 / 100)
        assert combined.sigma <= min(images, check.factor_sigma)
        joint = combined.sigma**-2
        assert joint == pytest.approx(images**-2 + check.factor_sigma**-2)


def test_over_a_wide_range_the_images_have_the_word() -> None:
    prior = prior_of(TILTS * 1.01)
    check = check_tilt(prior, prior.image_names, cameras(TILTS))
    assert combine_tilt(check, radians(60.0), radians(0.02)).weight < 0.12
