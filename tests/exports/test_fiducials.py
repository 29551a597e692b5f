from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.exports.fiducials import longest_tracks, view_errors
from tests.oracles.tilt_series import leave_out_error, rotation

NOISE_PX = 0.3


def views(count: int) -> tuple[np.ndarray, np.ndarray]:
    linear = np.array([rotation("y", 8.0 * i)[:2] for i in range(count)])
    return linear, np.arange(2.0 * count).reshape(count, 2)


def noisy_tracks(num_views: int, num_tracks: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    linear, middle = views(num_views)
    points = rng.normal(scale=50.0, size=(num_tracks, 3))
    track, image = np.nonzero(rng.random((num_tracks, num_views)) < 0.7)
    exact = np.einsum("oij,oj->oi", linear[image], points[track]) + middle[image]
    return linear, middle, image, track, exact + NOISE_PX * rng.normal(size=exact.shape)


def test_the_leave_out_error_is_that_of_a_fit_without_the_observation() -> None:
    linear, middle, image, track, xy = noisy_tracks(6, 5, seed=1)
    found = view_errors(linear, middle, image, track, xy)
    lengths: list[list[float]] = [[] for _ in range(6)]
    for j in range(5):
        rows = np.flatnonzero(track == j)
        for k, o in enumerate(rows):
            if len(rows) > 2:
                error = leave_out_error(linear, middle, image[rows], xy[rows], k)
                lengths[image[o]].append(float(np.linalg.norm(error)))
    expected = [np.mean(values) for values in lengths]
    np.testing.assert_allclose(found.leave_out_px, expected, rtol=1e-8)


def test_both_errors_are_what_the_noise_makes_them() -> None:
    linear, middle, image, track, xy = noisy_tracks(20, 2000, seed=2)
    found = view_errors(linear, middle, image, track, xy)
    mean_of_rayleigh = NOISE_PX * np.sqrt(np.pi / 2.0)
    assert 0.88 < found.residual_px.mean() / mean_of_rayleigh < 0.97
    assert 1.03 < found.leave_out_px.mean() / mean_of_rayleigh < 1.13
    np.testing.assert_array_equal(found.num_points, np.bincount(image))


def test_a_track_of_two_views_has_no_leave_out_error() -> None:
    linear, middle = views(3)
    image, track = np.array([0, 1]), np.array([0, 0])
    xy = middle[:2] + np.array([[1.0, 0.0], [2.0, 0.5]])
    found = view_errors(linear, middle, image, track, xy)
    assert np.isnan(found.leave_out_px).all()
    assert np.isfinite(found.residual_px[:2]).all()
    assert np.isnan(found.residual_px[2])


@pytest.mark.parametrize(("count", "chosen"), [(1, [1]), (2, [0, 1]), (9, [0, 1, 3])])
def test_the_longest_tracks_come_first_and_unseen_ones_never(count, chosen) -> None:
    track = np.array([0, 0, 1, 1, 1, 3])
    assert longest_tracks(track, count).tolist() == chosen
