"""The numbers of the calibration table, on errors whose deviation is known."""

import numpy as np
import pytest

from benchmarks.surface_sigma import CHOSEN, octaves, scales, tables
from benchmarks.truth.series import TEST, TRAIN


def gauss(num: int = 200_000, factor: float = 1.0) -> dict:
    rng = np.random.default_rng(0)
    sigma = 2.0 ** rng.uniform(-1.0, 1.0, num)
    error = factor * sigma * rng.normal(size=num)
    return {"error": error, "sigma": sigma, "cloud_error": error, "cloud_sigma": sigma}


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_scale_is_the_factor_by_which_sigmas_are_too_small(factor: float) -> None:
    d = gauss(factor=factor)
    np.testing.assert_allclose(scales(d["error"], d["sigma"]), factor, rtol=0.02)


def test_every_octave_has_its_own_scale_and_every_series_the_same_weight() -> None:
    small, large = gauss(num=20_000), gauss(num=200_000, factor=3.0)
    lines = [line.split(" | ") for line in octaves([small, small, large]).splitlines()[2:]]
    assert [line[0].lstrip("| ") for line in lines] == ["0.5 to 1", "1 to 2"]
    for line in lines:
        assert float(line[1].rstrip(" %")) == pytest.approx(50.0, abs=1.0)
        # two thirds of the weight have the scale 1
        assert 1.0 < float(line[2]) < 1.7


def test_fitted_and_held_out_series_do_not_mix() -> None:
    text = tables({"grain_101_24x115_usual": gauss(), "another": gauss()})
    held_out, fitted = text.split("Fitted to:")
    assert "| another |" in held_out
    assert "| grain_101_24x115_usual |" in fitted


def test_constants_were_fitted_to_series_of_the_training_set() -> None:
    assert {s.name for s in TRAIN} >= CHOSEN
    assert not CHOSEN & {s.name for s in TEST}
