import numpy as np
import pytest

from semsfm_colmap.metrology.sizes.surface_error import (
    FACING_CONCENTRATION,
    REACH,
    SLOW_SHARE,
    SLOW_WINDOWS,
    SurfaceError,
    surface_error,
)

RNG = np.random.default_rng(1)
ERROR = SurfaceError(common=0.4, facing=0.1, window=5.0)


def plain_window_sigma(points, along, own):
    d = np.linalg.norm(points[:, None] - points[None], axis=2)
    a = along * own
    share = np.where(d <= REACH * ERROR.window, np.exp(-d / ERROR.window), 0.0)
    slow = np.exp(-d / (SLOW_WINDOWS * ERROR.window))
    return np.sqrt(a @ ((1.0 - SLOW_SHARE) * share + SLOW_SHARE * slow) @ a)


def plain_facing_sigma(normals, along):
    share = np.exp(-FACING_CONCENTRATION * (1.0 - normals @ normals.T))
    return ERROR.facing * np.sqrt(along @ share @ along)


def test_the_part_within_windows_is_that_of_the_whole_matrix(monkeypatch):
    monkeypatch.setattr("semsfm_colmap.metrology.sizes.surface_error.BATCH", 37)
    monkeypatch.setattr("semsfm_colmap.metrology.sizes.surface_error.SLOW_BATCH", 7)
    points, along, own = (
        RNG.uniform(0, 40, (150, 3)),
        RNG.normal(size=150),
        RNG.uniform(0.5, 1, 150),
    )
    assert ERROR.window_sigma(points, along, own) == pytest.approx(
        plain_window_sigma(points, along, own), rel=0.02
    )
    # all with one sign, as in a mean: the slow part, made from cells, is then a good deal of it
    mean = np.full(150, 1.0 / 150)
    assert ERROR.window_sigma(points, mean, own) == pytest.approx(
        plain_window_sigma(points, mean, own), rel=0.02
    )


def test_the_part_by_facing_is_that_of_the_whole_matrix():
    normals = RNG.normal(size=(120, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = RNG.normal(size=120)
    assert ERROR.facing_sigma(normals, along) == pytest.approx(
        plain_facing_sigma(normals, along), rel=1e-4
    )


def mean_of_a_square(side):
    x, y = np.meshgrid(np.arange(0.0, side, 2.0), np.arange(0.0, side, 2.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    along = np.full(len(points), 1.0 / len(points))
    return ERROR.window_sigma(points, along, np.ones(len(points))), len(points)


def test_a_mean_is_not_more_certain_by_the_root_of_the_number_of_vertices():
    sigma, num = mean_of_a_square(60.0)
    assert sigma > 4.0 / np.sqrt(num)
    # windows alone would leave sigma^2 = 2 pi l^2 / area
    larger, _ = mean_of_a_square(120.0)
    assert 1.2 * np.sqrt(2 * np.pi * 25.0) / 120.0 < larger < 0.8 * sigma


def test_what_is_common_moves_a_mean_in_full_and_a_difference_not_at_all():
    assert ERROR.common_sigma(np.full(50, 1 / 50)) == pytest.approx(0.4)
    assert ERROR.common_sigma(np.repeat([1 / 25, -1 / 25], 25)) == pytest.approx(0.0)
    up = np.tile([0.0, 0.0, 1.0], (50, 1))
    assert ERROR.facing_sigma(up, np.repeat([1 / 25, -1 / 25], 25)) == pytest.approx(0.0)
    assert ERROR.facing_sigma(up, np.full(50, 1 / 50)) == pytest.approx(0.1, rel=1e-4)


def test_all_parts_together_are_the_sigma_of_a_vertex():
    sigma = np.array([0.9, 1.4])
    own = ERROR.own(sigma)
    np.testing.assert_allclose(np.sqrt(own**2 + 0.4**2 + 0.1**2), sigma)


def test_the_common_part_is_in_proportion_to_what_the_surest_vertices_are_uncertain_by():
    sigma = RNG.uniform(0.8, 3.0, 5000)
    one, two = surface_error(sigma, 1.0), surface_error(2.0 * sigma, 2.0)
    assert two.common == pytest.approx(2 * one.common)
    assert (two.facing, two.window) == pytest.approx((2 * one.facing, 2 * one.window))
    assert one.common == pytest.approx(0.35 * np.quantile(sigma, 0.1))
