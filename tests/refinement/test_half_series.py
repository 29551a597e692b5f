"""Odd and even images, each adjusted by itself."""

import numpy as np
import pytest

from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.half_series import half_series
from tests.dragged import dragged_scene, refined

SETTINGS = BundleSettings(sigma_px=0.1)


def test_halves_of_a_series_with_noise_only_agree():
    fit = refined(dragged_scene(0.0))
    found = half_series(fit.cameras, fit.observations, SETTINGS)
    assert abs(found.odd_deg) < 0.2
    assert abs(found.even_deg) < 0.2
    assert found.difference_deg == pytest.approx(found.odd_deg - found.even_deg)


def test_an_image_that_is_displaced_in_parts_sets_them_apart():
    def torn(R, normals, image, track):
        last = (image == image.max())[:, None]
        return 3.0 * last * normals[track][:, :2]

    clean = refined(dragged_scene(0.0))
    bad = dragged_scene(0.0, extra=torn)
    found = half_series(clean.cameras, bad.observations, SETTINGS)
    calm = half_series(clean.cameras, clean.observations, SETTINGS)
    assert abs(found.difference_deg) > 3 * abs(calm.difference_deg)


def test_a_half_of_two_images_does_not_stand_by_itself():
    fit = refined(dragged_scene(0.0, num_images=5, range_deg=30.0))
    assert half_series(fit.cameras, fit.observations, SETTINGS) is None
    assert np.isfinite(fit.sigma_px)
