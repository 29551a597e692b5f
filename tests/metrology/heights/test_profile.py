import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.profile import (
    line_profile,
    profile_parameters,
    profile_unit,
    roughness_profile,
)
from tests.metrology.heights.surfaces import a_map


def test_a_wave_has_the_parameters_of_its_formulas():
    x = np.arange(10006) * 0.01
    found = profile_parameters(2.0 * np.sin(2.0 * np.pi * x / 2.0 + 0.1), 0.01)
    slope = 2.0 * np.pi
    expected = {
        "Ra": 4.0 / np.pi,
        "Rq": np.sqrt(2.0),
        "Rp": 2.0,
        "Rv": 2.0,
        "Rz": 4.0,
        "Rt": 4.0,
        "Rku": 1.5,
        "Rdq": slope / np.sqrt(2.0),
        "Rda": 2.0 * slope / np.pi,
        "Rsm": 2.0,
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-3), name
    assert found["Rsk"] == pytest.approx(0.0, abs=1e-3)


def test_ripples_below_a_tenth_of_the_height_are_no_elements():
    x = np.arange(5000) * 0.01
    z = np.sin(2.0 * np.pi * x / 5.0) + 0.05 * np.sin(2.0 * np.pi * x / 0.21)
    assert profile_parameters(z, 0.01)["Rsm"] == pytest.approx(5.0, rel=0.01)


def test_peaks_are_means_over_the_sections_and_the_total_is_over_all():
    z = np.zeros(500)
    z[50], z[150], z[450] = 1.0, 2.0, -5.0
    z = z - z.mean()
    found = profile_parameters(z, 1.0)
    parts = z.reshape(5, 100)
    assert found["Rp"] == pytest.approx(parts.max(axis=1).mean())
    assert found["Rv"] == pytest.approx(-parts.min(axis=1).mean())
    assert found["Rt"] == pytest.approx(7.0)


def test_the_letter_says_which_profile_it_is():
    assert "Pq" in profile_parameters(np.sin(np.arange(200.0)), 1.0, letter="P")


def test_the_roughness_profile_has_neither_form_nor_noise():
    x = np.arange(2000.0)
    form, wave = 1e-5 * (x - 900.0) ** 2, np.sin(2.0 * np.pi * x / 50.0)
    noise = np.random.default_rng(1).normal(scale=0.3, size=2000)
    found = roughness_profile(form + wave + noise, 1.0, 10.0, 250.0)[300:-300]
    assert np.std(found) == pytest.approx(np.std(wave), rel=0.05)


def test_a_profile_of_few_points_is_refused():
    with pytest.raises(InputError, match="longer line"):
        profile_parameters(np.zeros(20), 1.0)


def test_a_profile_with_a_hole_has_no_mean_width_but_the_rest():
    z = np.sin(np.arange(600.0) / 5.0)
    z[100:110] = np.nan
    found = profile_parameters(z, 1.0)
    assert np.isnan(found["Rsm"])
    assert found["Rq"] == pytest.approx(np.sqrt(0.5), rel=0.02)


def test_a_line_of_a_map_has_the_heights_between_its_cells():
    y, x = np.mgrid[0:40, 0:60].astype(float)
    height_map = a_map(0.5 * x + 0.2 * y, 2.0, 1.0)
    z, spacing = line_profile(height_map, (0.0, 0.0), (60.0, 30.0))
    assert spacing == pytest.approx(np.hypot(60.0, 30.0) / (len(z) - 1))
    np.testing.assert_allclose(z, np.linspace(0.0, 0.5 * 30.0 + 0.2 * 30.0, len(z)), atol=1e-9)


def test_a_line_over_a_hole_has_a_gap_and_one_beside_the_map_is_refused():
    z = np.zeros((40, 60))
    z[15:25, 20:30] = np.nan
    heights, _ = line_profile(a_map(z), (0.0, 20.0), (59.0, 20.0))
    assert np.isnan(heights).sum() >= 10
    with pytest.raises(InputError, match="no measured cell"):
        line_profile(a_map(z), (100.0, 100.0), (150.0, 100.0))
    with pytest.raises(InputError, match="no length"):
        line_profile(a_map(z), (5.0, 5.0), (5.0, 5.0))


def test_parameters_have_the_units_of_their_kind():
    assert [profile_unit(n, "um") for n in ("Rq", "Psm", "Rsk", "Rdl")] == ["um", "um", "", "%"]
