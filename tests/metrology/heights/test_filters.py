import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.metrology.heights.filters import gaussian, robust_gaussian, support, transmission
from tests.metrology.heights.surfaces import rough, waves
from tests.oracles import areal as oracle


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_filter_is_the_least_squares_fit_at_every_cell(order):
    z = rough(20, 24, 6.0, 1.0, seed=1, holes=0.15)
    found = gaussian(z, (0.7, 1.0), 6.0, order=order)
    expected = oracle.regression(z, np.isfinite(z).astype(float), 1.0, 0.7, 6.0, order)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    assert np.array_equal(np.isnan(found), np.isnan(z))


@pytest.mark.parametrize("length", [10.0, 20.0, 40.0, 80.0])
def test_a_wave_passes_with_the_transmission_of_the_standard(length):
    wave = waves(1.0, length, 400, 400.0 / length)
    passed = gaussian(wave.z, wave.spacing, 20.0)[50:-50, 50:-50]
    assert passed.std() / wave.z[50:-50, 50:-50].std() == pytest.approx(
        float(transmission(length, 20.0)), abs=1e-3
    )
    if length == 20.0:
        assert transmission(length, 20.0) == pytest.approx(0.5)


@pytest.mark.parametrize("order", [1, 2])
def test_a_tilted_plane_with_holes_passes_unchanged_up_to_the_ends(order):
    y, x = np.mgrid[0:60, 0:80].astype(float)
    z = 2.0 + 0.3 * x - 0.2 * y
    z[20:35, 10:40] = np.nan
    np.testing.assert_allclose(gaussian(z, (1.0, 1.0), 15.0, order=order), z, atol=1e-4)


def test_curvature_passes_the_filter_of_second_order_up_to_the_ends():
    x = np.arange(200.0)
    z = 0.01 * (x - 70.0) ** 2
    np.testing.assert_allclose(gaussian(z, (1.0,), 30.0, order=2), z, atol=1e-3)
    assert np.abs(gaussian(z, (1.0,), 30.0, order=1) - z).max() > 0.1


def test_a_profile_is_filtered_as_a_row_of_a_map_that_is_the_same_everywhere():
    z = np.random.default_rng(2).normal(size=300)
    many = np.broadcast_to(z, (81, 300))
    row = gaussian(many, (1.0, 1.0), 20.0)[40]
    np.testing.assert_allclose(gaussian(z, (1.0,), 20.0), row, atol=1e-9)


def test_deep_pits_do_not_pull_the_robust_filter():
    x = np.arange(400.0)
    smooth = np.sin(2.0 * np.pi * x / 400.0)
    rng = np.random.default_rng(4)
    z = smooth + rng.normal(scale=0.02, size=400)
    z[::40] -= 5.0
    robust = robust_gaussian(z, (1.0,), 60.0)
    assert np.abs(robust - smooth).max() < 0.05
    assert np.abs(gaussian(z, (1.0,), 60.0, order=2) - smooth).mean() > 0.1


def test_the_robust_filter_repeats_the_fit_with_tukeys_weights():
    z = rough(16, 18, 6.0, 1.0, seed=1, holes=0.05) + rough(16, 18, 3.0, 0.1, seed=2)
    z[4, 5], z[10, 11] = 9.0, -12.0
    expected = oracle.robust_regression(z, 1.0, 1.0, 6.0)
    np.testing.assert_allclose(robust_gaussian(z, (1.0, 1.0), 6.0), expected, atol=1e-4)


def test_two_filters_in_turn_are_one_with_the_root_of_the_squares():
    z = rough(160, 160, 4.0, 1.0, seed=7)
    both = gaussian(gaussian(z, (1.0, 1.0), 15.0), (1.0, 1.0), 20.0)[50:-50, 50:-50]
    np.testing.assert_allclose(gaussian(z, (1.0, 1.0), 25.0)[50:-50, 50:-50], both, atol=2e-4)


def test_a_nesting_index_of_two_cells_is_refused():
    with pytest.raises(UsageError, match="more than two cells"):
        gaussian(np.zeros((20, 20)), (1.0, 1.0), 2.0)


def test_an_unknown_order_is_refused():
    with pytest.raises(UsageError, match="order=3"):
        gaussian(np.zeros(20), (1.0,), 5.0, order=3)


def test_half_of_the_weights_are_there_on_an_end_and_a_quarter_in_a_corner():
    share = support(np.ones((100, 120), dtype=bool), (1.0, 2.0), 30.0)
    assert share[50, 60] == pytest.approx(1.0)
    assert share[0, 60] == pytest.approx(0.5, abs=0.05)
    assert share[0, 0] == pytest.approx(0.25, abs=0.06)
