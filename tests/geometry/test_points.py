import numpy as np
import pytest

from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from tests.oracles.geometry import solve_point


@pytest.fixture
def problem():
    rng = np.random.default_rng(3)
    A, t = rng.normal(size=(6, 2, 3)), rng.normal(size=(6, 2))
    X = rng.normal(size=(20, 3))
    track_idx = np.repeat(np.arange(20), 4)
    image_idx = np.concatenate([np.sort(rng.permutation(6)[:4]) for _ in range(20)])
    xy = np.einsum("oij,oj->oi", A[image_idx], X[track_idx]) + t[image_idx]
    return A, t, X, image_idx, track_idx, xy, rng


def test_points_agree_with_dense_least_squares_for_any_weights(problem):
    A, t, _, image_idx, track_idx, xy, rng = problem
    xy = xy + rng.normal(size=xy.shape)
    w = rng.uniform(0.1, 2.0, len(xy))
    X = solve_points(A, t, image_idx, track_pointer(track_idx, 20), xy, w)
    for j in range(20):
        o = track_idx == j
        assert np.allclose(X[j], solve_point(A[image_idx[o]], t[image_idx[o]], xy[o], w[o]))


def test_noise_free_points_are_recovered_and_leave_no_residual(problem):
    A, t, X, image_idx, track_idx, xy, _ = problem
    found = solve_points(A, t, image_idx, track_pointer(track_idx, 20), xy, np.ones(len(xy)))
    assert np.allclose(found, X)
    assert np.allclose(residuals(A, t, found, image_idx, track_idx, xy), 0.0)


def test_parallel_rays_give_no_point():
    A = np.repeat(np.eye(3)[None, :2], 3, axis=0)
    X = solve_points(
        A, np.zeros((3, 2)), np.arange(3), np.array([0, 3]), np.ones((3, 2)), np.ones(3)
    )
    assert np.isnan(X).all()


def test_a_track_without_observations_gives_no_point(problem):
    A, t, _, image_idx, track_idx, xy, _ = problem
    pointer = track_pointer(track_idx, 21)
    assert np.isnan(solve_points(A, t, image_idx, pointer, xy, np.ones(len(xy)))[20]).all()
