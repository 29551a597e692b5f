"""What is background beside a specimen."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.stereo.background import background, uncorrelated_region


def test_the_halo_around_a_specimen_is_background_and_the_specimen_is_not() -> None:
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:120, 0:160]
    inside = (x - 80) ** 2 + (y - 60) ** 2 < 35**2
    halo = (x - 80) ** 2 + (y - 60) ** 2 < 39**2
    grey = np.where(inside, 140.0 + 20 * rng.random(x.shape), 20.0).astype(np.float32)
    grey += rng.normal(0, 2, grey.shape).astype(np.float32)
    correlation = np.where(halo, 0.9, 0.15).astype(np.float32)
    found = background(grey, uncorrelated_region(correlation, grey, 4), 4, 2.0)
    assert (found & inside).sum() <= 0.03 * inside.sum()
    assert (found & ~inside).sum() >= 0.98 * (~inside).sum()


def test_an_image_filled_by_the_specimen_has_no_background() -> None:
    correlation = np.full((60, 80), 0.8, dtype=np.float32)
    correlation[10:14, 10:14] = 0.0
    grey = np.full((60, 80), 90, np.float32)
    empty = uncorrelated_region(correlation, grey, 4)
    assert not background(grey, empty, 4, 2.0).any()


def test_little_texture_under_noise_is_no_background_and_a_chamber_as_uncorrelated_is() -> None:
    rng = np.random.default_rng(2)
    grey = rng.normal(90.0, 8.0, (120, 160)).astype(np.float32)
    correlation = np.full(grey.shape, 0.6, dtype=np.float32)
    correlation[20:60, 20:80] = correlation[70:110, 90:150] = 0.28
    assert not uncorrelated_region(correlation, grey, 4).any()
    for level in (30.0, 150.0):
        other = grey.copy()
        other[70:110, 90:150] += level - 90.0
        found = uncorrelated_region(correlation, other, 4)
        assert found[76:104, 96:144].all()
        assert not found[:66].any()


def test_without_contrast_only_the_region_itself_is_background() -> None:
    correlation = np.full((60, 80), 0.8, dtype=np.float32)
    correlation[:, :30] = 0.0
    empty = uncorrelated_region(correlation, np.full((60, 80), 90, np.float32), 2)
    np.testing.assert_array_equal(
        background(np.full((60, 80), 90, np.float32), empty, 4, 2.0), empty
    )
