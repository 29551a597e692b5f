from itertools import pairwise

import numpy as np
import pytest

from semsfm_colmap.refinement import noise
from semsfm_colmap.refinement.noise import MIN_SIGMA_PX, noise_sigma


def residuals_of_mean_points(num_tracks=4000, seed=0, sigma_px=0.3):
    """Tracks of two to six observations, each fitted three numbers: residuals of a linear fit."""
    rng = np.random.default_rng(seed)
    length = rng.integers(2, 7, num_tracks)
    pointer = np.concatenate([[0], np.cumsum(length)])
    relative = rng.uniform(0.5, 2.0, pointer[-1])
    r = np.empty((pointer[-1], 2))
    for begin, end in pairwise(pointer):
        k = 2 * (end - begin)
        root = np.repeat(1.0 / relative[begin:end], 2)
        Q, _ = np.linalg.qr(root[:, None] * rng.normal(size=(k, 3)))
        white = sigma_px * rng.normal(size=k)
        r[begin:end] = ((white - Q @ (Q.T @ white)) / root).reshape(-1, 2)
    return r, 1.0 / relative**2, pointer


@pytest.mark.parametrize("sample", [2000, 10**6])
def test_what_the_points_take_is_given_back(sample, monkeypatch):
    monkeypatch.setattr(noise, "MEDIAN_SAMPLE", sample)
    r, precision, pointer = residuals_of_mean_points()
    assert 0.295 < noise_sigma(r, precision, pointer, 0) < 0.305


def test_residuals_of_a_long_track_are_the_noise():
    r = 0.3 * np.random.default_rng(0).normal(size=(20000, 2))
    assert 0.295 < noise_sigma(r, np.ones(20000), np.array([0, 20000]), 0) < 0.305


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_wrong_observations_have_no_say(share):
    r, precision, pointer = residuals_of_mean_points()
    rng = np.random.default_rng(1)
    wrong = rng.random(len(r)) < share
    r[wrong] = rng.uniform(-100, 100, (wrong.sum(), 2))
    # more of the clean ones' tail is within a limit that the wrong ones have moved
    assert 0.28 < noise_sigma(r, precision, pointer, 0) < 0.33


def test_exact_data_have_the_least_noise_that_is_believed():
    r = np.zeros((100, 2))
    assert noise_sigma(r, np.ones(100), np.arange(0, 101, 5), 3) == MIN_SIGMA_PX
