from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.metrology.heights.areal import areal_parameters
from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.parameter_uncertainty import (
    ErrorModel,
    correlated_field,
    measured_parameters,
)
from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer, scale_limited
from tests.metrology.heights.surfaces import a_map, rough

T = Transfer(nesting_index=8.0, sigma=0.8)
FILTERING = Filtering(s_index=16.0)


def test_a_correlated_field_has_unit_variance_up_to_the_ends_and_the_filters_correlation():
    like = a_map(np.zeros((200, 220)))
    fields = np.array([correlated_field(like, 10.0, np.random.default_rng(k)) for k in range(30)])
    assert fields.std() == pytest.approx(1.0, abs=0.05)
    assert fields[:, :3].std() == pytest.approx(1.0, abs=0.15)
    # white noise behind the filter twice: a Gaussian root(2) wider
    shift = 5
    alpha = np.sqrt(np.log(2.0) / np.pi)
    expected = np.exp(-np.pi * shift**2 / (alpha * 10.0) ** 2 / 2.0)
    assert np.mean(fields[:, :, shift:] * fields[:, :, :-shift]) == pytest.approx(
        expected, abs=0.05
    )


def test_a_field_finer_than_the_grid_is_white():
    field = correlated_field(a_map(np.zeros((100, 100))), 1.0, np.random.default_rng(1))
    assert np.mean(field[:, 1:] * field[:, :-1]) == pytest.approx(0.0, abs=0.03)


def measured(z_true: np.ndarray, seed: int) -> HeightMap:
    """A truth as a reconstruction has it: filtered by a T that errs, plus correlated noise."""
    rng = np.random.default_rng(seed)
    index = T.nesting_index + T.sigma * rng.normal()
    like = a_map(z_true, sigma=0.3)
    z = gaussian(z_true, (1.0, 1.0), index)
    return like.with_heights(z + 0.3 * correlated_field(like, T.nesting_index, rng))


def test_pulls_of_simulated_surfaces_are_near_one():
    names = ("Sq", "Sa", "Sdq", "Sdr", "Sk", "Svk", "Sku", "Sal")
    model = ErrorModel(transfer=T, noise_share=1.0)
    pulls = []
    for seed in range(12):
        truth = rough(110, 120, 12.0, 2.0, seed=seed)
        known = areal_parameters(scale_limited(a_map(truth), FILTERING))
        found = measured_parameters(
            measured(truth, seed + 100), FILTERING, model, areal_parameters,
            np.random.default_rng(seed), num_draws=12,
        )  # fmt: skip
        pulls.append([(found[n].value - known[n]) / found[n].sigma for n in names])
    rms = np.sqrt(np.mean(np.square(pulls)))
    assert 0.6 < rms < 1.4


def test_sources_add_in_quadrature_and_what_is_unknown_is_not_assessed():
    z = rough(80, 80, 12.0, 1.0, seed=1)
    model = ErrorModel(transfer=T, scale_sigma=0.02, noise_share=1.0)
    found = measured_parameters(
        a_map(z, sigma=0.1), FILTERING, model, areal_parameters,
        np.random.default_rng(0), num_draws=5,
    )  # fmt: skip
    Sq = found["Sq"]
    known = [u for u in Sq.sources.values() if u is not None]
    assert Sq.sources["amplification"] is None
    assert Sq.sources["scale"] == pytest.approx(0.02 * Sq.value)
    assert Sq.sigma == pytest.approx(np.sqrt(np.sum(np.square(known))))
    assert Sq.interval == pytest.approx((Sq.value - 1.96 * Sq.sigma, Sq.value + 1.96 * Sq.sigma))
    assert found["Sdq"].sources["scale"] == found["Ssk"].sources["scale"] == 0.0


def test_amplification_acts_on_heights_and_slopes_and_not_on_shape():
    z = rough(80, 80, 12.0, 1.0, seed=1)
    model = ErrorModel(transfer=T, amplification_sigma=0.01)
    found = measured_parameters(
        a_map(z), FILTERING, model, areal_parameters, np.random.default_rng(0)
    )
    for name in ("Sq", "Sk", "Sdq", "Vmc"):
        assert found[name].sources["amplification"] == pytest.approx(
            0.01 * found[name].value, rel=1e-6
        )
    for name in ("Ssk", "Sku", "Smr1", "Str"):
        assert found[name].sources["amplification"] == pytest.approx(0.0, abs=1e-9)
    # no sigma, no Monte Carlo
    assert found["Sq"].sources["noise"] is None


def test_the_nearer_the_s_filter_is_to_the_transfer_the_less_slopes_are_known():
    z = rough(80, 80, 8.0, 1.0, seed=2)
    parts = []
    for index in (10.0, 16.0, 30.0):
        filtering = replace(FILTERING, s_index=index)
        found = measured_parameters(
            a_map(z), filtering, ErrorModel(transfer=T), areal_parameters, np.random.default_rng(0)
        )["Sdq"]
        parts.append(found.sources["transfer"] / found.value)
    assert parts[0] > 2.0 * parts[1] > 4.0 * parts[2]


def test_the_same_seed_gives_the_same_budget():
    z = rough(60, 60, 12.0, 1.0, seed=1)
    model = ErrorModel(transfer=T)
    once, again = (
        measured_parameters(
            a_map(z, sigma=0.1), FILTERING, model, areal_parameters,
            np.random.default_rng(5), num_draws=3,
        )
        for _ in range(2)
    )  # fmt: skip
    assert once["Sq"].sigma == again["Sq"].sigma
