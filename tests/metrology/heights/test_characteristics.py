import numpy as np
import pytest

from semsfm_colmap.metrology.heights.characteristics import (
    NOT_ASSESSED,
    amplification,
    characteristics,
    height_map_of_points,
    ring_correlation,
)
from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer
from tests.metrology.heights.surfaces import a_map, rough

TRUTH = rough(400, 400, 16.0, 2.0, seed=1)
BLURRED = gaussian(TRUTH, (1.0, 1.0), 15.0)
FILTERING, T = Filtering(s_index=30.0), Transfer(nesting_index=15.0)


def of(found, symbol):
    return next(c for c in found if c.symbol == symbol)


def test_a_truth_tells_amplification_linearity_flatness_and_the_period_limit():
    found = characteristics(a_map(1.03 * BLURRED), FILTERING, T, truth=a_map(TRUTH))
    # along the ends two filters in turn are not quite the one that they are inside
    assert of(found, "alpha_z").value == pytest.approx(1.03, abs=0.008)
    assert of(found, "D_LIM").value == pytest.approx(15.0, rel=0.05)
    assert of(found, "l_z").value < 0.03
    # the largest heights are 3 % too far out, both ways; more along the ends
    heights = np.ptp(gaussian(TRUTH, (1.0, 1.0), 30.0))
    assert 0.03 * heights < of(found, "z_FLT").value < 0.15 * heights


def test_the_noise_of_half_of_the_frames_is_their_difference_over_root_two():
    rng = np.random.default_rng(2)
    halves = tuple(
        a_map(BLURRED + gaussian(rng.normal(size=TRUTH.shape), (1.0, 1.0), 6.0)) for _ in range(2)
    )
    found = of(characteristics(a_map(BLURRED), FILTERING, T, halves=halves), "N_M")
    expected = np.std(
        [gaussian(h.z - BLURRED, (1.0, 1.0), 30.0) for h in halves], axis=(1, 2)
    ).mean()
    assert found.value == pytest.approx(expected, rel=0.1)


def test_what_nobody_measured_is_not_assessed():
    for c in characteristics(a_map(BLURRED), FILTERING, T):
        assert c.value is None
        assert c.how.startswith(NOT_ASSESSED)


def test_known_steps_tell_the_amplification():
    slope, linearity = amplification(None, None, [(0.0, 0.0), (1.0, 0.98), (2.0, 1.96)])
    assert slope.value == pytest.approx(0.98)
    assert linearity.value == pytest.approx(0.0, abs=1e-9)


def test_the_halves_agree_down_to_the_period_at_which_noise_takes_over():
    rng = np.random.default_rng(3)
    halves = [a_map(BLURRED + 0.05 * rng.normal(size=TRUTH.shape)) for _ in range(2)]
    frequency, correlation = ring_correlation(*halves)
    assert correlation[frequency < 1 / 30.0].min() > 0.95
    assert np.abs(correlation[frequency > 1 / 3.0]).mean() < 0.2
    # power of signal and noise are known: half of the correlation where they are alike
    period = of(
        characteristics(halves[0], FILTERING, T, halves=(halves[0], halves[1])), "FRC 1/2"
    ).value
    assert 5.0 < period < 15.0


def test_two_halves_that_share_nothing_are_refused():
    from semsfm_colmap.errors import InputError

    z = np.full((40, 40), np.nan)
    with pytest.raises(InputError, match="share 0 cells"):
        ring_correlation(a_map(z), a_map(BLURRED[:40, :40]))


def test_a_cloud_becomes_heights_on_the_grid_of_a_map_and_gaps_stay_holes():
    like = a_map(np.zeros((40, 50)))
    like = type(like)(z=like.z, spacing=(1.0, 1.0), unit="um", origin=np.zeros(3), axes=np.eye(3))
    rng = np.random.default_rng(1)
    place = rng.uniform([0.0, 0.0], [49.0, 39.0], size=(4000, 2))
    place = place[np.linalg.norm(place - [25.0, 20.0], axis=1) > 8.0]
    points = np.column_stack([place, 0.2 * place[:, 0] - 0.1 * place[:, 1]])
    found = height_map_of_points(points, like)
    y, x = np.mgrid[0:40, 0:50]
    known = np.isfinite(found.z)
    np.testing.assert_allclose(found.z[known], (0.2 * x - 0.1 * y)[known], atol=1e-9)
    assert np.isnan(found.z[20, 25])
    assert known.mean() > 0.8
