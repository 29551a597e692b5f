import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.metrology.heights.levelling import level
from tests.metrology.heights.surfaces import a_map, rough

Y, X = np.mgrid[0:80, 0:100].astype(float)


@pytest.mark.parametrize("form", ["plane", "polynomial"])
def test_a_tilted_plane_becomes_flat_and_holes_stay(form):
    z = 3.0 + 0.2 * X - 0.1 * Y
    z[10:20, 30:50] = np.nan
    found = level(a_map(z), form).height_map
    assert np.nanmax(np.abs(found.z)) < 1e-9
    assert np.array_equal(np.isnan(found.z), np.isnan(z))


def test_a_polynomial_takes_its_degree_and_no_more():
    z = 1e-4 * (X - 40.0) ** 2 * (Y - 30.0)
    assert np.abs(level(a_map(z), "polynomial", degree=3).height_map.z).max() < 1e-8
    assert np.abs(level(a_map(z), "polynomial", degree=2).height_map.z).max() > 0.1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sphere_is_found_with_its_radius_whether_it_bulges_or_not(side):
    z = 5.0 + side * np.sqrt(150.0**2 - (X - 55.0) ** 2 - (Y - 38.0) ** 2)
    found = level(a_map(z), "sphere")
    assert found.radius == pytest.approx(side * 150.0, rel=1e-6)
    assert np.abs(found.height_map.z).max() < 1e-6


def test_a_pit_does_not_tilt_the_plane():
    z = 0.1 * X + rough(80, 100, 5.0, 0.1, seed=1)
    clean = level(a_map(z), "plane").form
    z[:20, :20] -= 20.0
    assert np.abs(level(a_map(z), "plane").form - clean).max() < 0.1


def test_no_form_takes_the_mean_alone():
    found = level(a_map(0.1 * X + 7.0), "none").height_map
    assert found.z.mean() == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(found.z) == pytest.approx(9.9)


def test_a_flat_surface_is_no_sphere():
    with pytest.raises(InputError, match="not curved"):
        level(a_map(np.zeros((50, 50))), "sphere")


def test_a_polynomial_of_degree_zero_is_refused():
    with pytest.raises(UsageError, match="degree=0"):
        level(a_map(np.zeros((50, 50))), "polynomial", degree=0)


def test_a_form_that_the_cells_do_not_decide_is_refused():
    z = np.full((40, 40), np.nan)
    z[20] = 1.0
    with pytest.raises(InputError, match="do not decide"):
        level(a_map(z), "plane")
