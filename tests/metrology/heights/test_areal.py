import numpy as np
import pytest
from scipy.special import ellipe
from scipy.stats import norm

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.areal import (
    areal_parameters,
    inverse_material_ratios,
    material_ratios,
    parameter_unit,
    undefined,
)
from tests.metrology.heights.surfaces import a_map, rough, waves
from tests.oracles import areal as oracle

PERMILLE = 1e-3


@pytest.mark.parametrize("holes", [0.0, 0.01])
def test_all_parameters_are_those_of_their_definitions(holes):
    z = rough(60, 70, 8.0, 1.3, seed=3, holes=holes)
    found = areal_parameters(a_map(z, 1.0, 0.5))
    expected = {**oracle.heights(z), **oracle.gradients(z, 1.0, 0.5)}
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9), name
    for name, value in oracle.material(z).items():
        # the oracle samples the curve at 200 001 places
        assert found[name] == pytest.approx(value, rel=1e-4, abs=1e-3), name


def test_a_wave_has_the_parameters_of_its_formulas():
    amplitude, length = 3.0, 37.0
    steep = 2.0 * np.pi * amplitude / length
    found = areal_parameters(waves(amplitude, length, 1000, 99.0))
    # of 1006 cells 1000 have a slope: 49 whole waves
    inner = areal_parameters(waves(amplitude, length, 1006, 49.0 * 1.006))
    developed = 2.0 / np.pi * np.hypot(1.0, steep) * ellipe(steep**2 / (1.0 + steep**2)) - 1.0
    expected = {
        "Sq": amplitude / np.sqrt(2.0),
        "Sa": 2.0 * amplitude / np.pi,
        "Sku": 1.5,
        "Sdq": steep / np.sqrt(2.0),
        "Sdr": 100.0 * developed,
        "Std": 90.0,
    }
    for name, value in expected.items():
        measured = inner if name in ("Sdq", "Sdr") else found
        assert measured[name] == pytest.approx(value, rel=PERMILLE), name
    assert found["Ssk"] == pytest.approx(0.0, abs=1e-6)
    long = a_map(waves(amplitude, length, 3000, 299.0).z[:40], length * 299.0 / 3000.0)
    expected_sal = length * np.arccos(0.2) / (2.0 * np.pi)
    assert areal_parameters(long)["Sal"] == pytest.approx(expected_sal, rel=PERMILLE)
    assert found["Sz"] == pytest.approx(2.0 * amplitude, rel=0.05)


@pytest.mark.parametrize("deg", [0.0, 30.0, 90.0, 145.0])
def test_the_direction_of_the_texture_is_across_its_waves(deg):
    found = areal_parameters(waves(1.0, 20.0, 400, 20.0, deg))
    assert (found["Std"] - deg - 90.0 + 45.0) % 180.0 - 45.0 == pytest.approx(0.0, abs=1.0)
    assert np.isnan(found["Str"])
    assert "every direction" in undefined(found)["Str"]


def test_a_texture_without_direction_has_none_and_says_so():
    found = areal_parameters(a_map(rough(200, 200, 12.0, 1.0, seed=5)))
    assert found["Str"] > 0.8
    assert np.isnan(found["Std"])
    assert "no direction" in undefined(found)["Std"]


def test_gaussian_noise_has_the_parameters_of_the_normal_distribution():
    z = np.random.default_rng(0).normal(scale=2.0, size=(1000, 1000))
    found = areal_parameters(a_map(z))
    p = np.linspace(0.3, 0.7, 100001)
    slope, offset = np.polyfit(p, norm.isf(p), 1)
    mr1 = norm.sf(offset)
    peak = norm.pdf(norm.isf(mr1)) - mr1 * offset
    at = norm.isf(0.1)
    expected = {
        "Sq": 2.0,
        "Sa": 2.0 * np.sqrt(2.0 / np.pi),
        "Sku": 3.0,
        "Vmp": 2.0 * (norm.pdf(at) - 0.1 * at),
        "Spk": 2.0 * 2.0 * peak / mr1,
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=5e-3), name
    # the secant's least fall is chosen among many: a little less than that of the middle
    assert found["Sk"] == pytest.approx(-2.0 * slope, rel=5e-3)
    assert found["Smr1"] + found["Smr2"] == pytest.approx(100.0, abs=0.5)


def test_the_autocorrelation_is_that_of_the_pairs_that_are_measured():
    from semsfm_colmap.metrology.heights.texture import autocorrelation

    z = rough(30, 34, 5.0, 1.0, seed=2, holes=0.1)
    f = autocorrelation(z)
    middle = [n // 2 for n in f.shape]
    for lag_y, lag_x in ((0, 0), (3, 0), (0, -4), (-5, 7)):
        assert f[middle[0] + lag_y, middle[1] + lag_x] == pytest.approx(
            oracle.autocorrelation(z, lag_y, lag_x), abs=1e-9
        )


def test_lengths_scale_with_the_unit_and_shape_does_not():
    z = rough(80, 80, 9.0, 1.0, seed=1)
    one, ten = areal_parameters(a_map(z)), areal_parameters(a_map(10.0 * z, 10.0, 10.0))
    for name, value in one.items():
        factor = 10.0 if parameter_unit(name, "um").startswith("um") else 1.0
        if np.isfinite(value):
            assert ten[name] == pytest.approx(factor * value, rel=1e-9), name


def test_material_ratios_and_heights_are_inverse():
    height_map = a_map(rough(90, 90, 9.0, 1.0, seed=1))
    heights = inverse_material_ratios(height_map, [10.0, 50.0, 95.0])
    assert material_ratios(height_map, heights) == pytest.approx([10.0, 50.0, 95.0], abs=1e-6)
    assert material_ratios(height_map, [1e9, -1e9]) == [0.0, 100.0]


def test_a_flat_surface_has_no_shape_and_says_so():
    found = areal_parameters(a_map(np.zeros((40, 40))))
    assert found["Sq"] == found["Sk"] == found["Sdr"] == 0.0
    assert undefined(found)["Ssk"] == "the surface is flat"


def test_a_map_of_holes_is_refused():
    with pytest.raises(InputError, match="holes only"):
        areal_parameters(a_map(np.full((30, 30), np.nan)))
