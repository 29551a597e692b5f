from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.metrology.heights.coarse_registration import best_shift
from semsfm_colmap.metrology.heights.comparison import compare_surfaces, correlation_area
from semsfm_colmap.metrology.heights.filters import kernel
from semsfm_colmap.metrology.heights.parameter_uncertainty import correlated_field
from semsfm_colmap.metrology.heights.registration import register
from semsfm_colmap.types import TriangleMesh
from tests.metrology.heights.surfaces import a_map, rough, sheet

T = 4.0
SIGMA = 0.1
TRUTH = rough(70, 80, 12.0, 2.0, seed=3)
Y, X = np.mgrid[0:70, 0:80].astype(float)
PIT = -1.5 * np.exp(-(((X - 30.0) / 8.0) ** 2) - ((Y - 35.0) / 8.0) ** 2)
TURN = rotation_from_vector(np.array([[0.5, -0.2, 2.2]]))[0]
SHIFT = np.array([100.0, -40.0, 7.0])


def noisy(z: np.ndarray, seed: int) -> TriangleMesh:
    field = correlated_field(a_map(z), T, np.random.default_rng(seed))
    return sheet(z + SIGMA * field, sigma=SIGMA)


def elsewhere(mesh: TriangleMesh, scale: float = 1.0) -> TriangleMesh:
    """The same surface in another world."""
    return replace(
        mesh,
        vertices=scale * mesh.vertices @ TURN.T + SHIFT,
        vertex_sigma=scale * mesh.vertex_sigma,
    )


def test_a_surface_in_another_world_comes_to_lie_on_itself():
    mesh = sheet(TRUTH, sigma=SIGMA)
    found = register(mesh, elsewhere(mesh), correlation_area(T)).fixed_from_moving
    assert rotation_angle((found.rotation @ TURN)[None])[0] < 1e-5
    np.testing.assert_allclose(found.apply(elsewhere(mesh).vertices), mesh.vertices, atol=1e-3)


@pytest.mark.slow
def test_the_scale_is_found_where_it_is_free():
    mesh = sheet(TRUTH, sigma=SIGMA)
    found = register(mesh, elsewhere(mesh, 1.02), correlation_area(T), with_scale=True)
    assert found.fixed_from_moving.scale == pytest.approx(1.0 / 1.02, rel=1e-4)


def test_surfaces_that_share_a_part_alone_come_together_on_it():
    wide = rough(110, 130, 12.0, 2.0, seed=8)
    one, other = sheet(wide[:, :85], sigma=SIGMA), sheet(wide[20:, 40:], sigma=SIGMA)
    found = register(one, elsewhere(other), correlation_area(T)).fixed_from_moving
    placed = found.apply(elsewhere(other).vertices)
    # row 0, column 0 of the second is row 20, column 40 of the first
    np.testing.assert_allclose(placed[0], [40.0, 20.0, wide[20, 40]], atol=0.01)


def test_a_pit_is_shown_where_it_is_and_its_volume_holds():
    found = compare_surfaces(noisy(TRUTH, 1), elsewhere(noisy(TRUTH + PIT, 2)), "um", T)
    volume = -PIT.sum()
    assert abs(found.lost.value - volume) < 3.0 * found.lost.sigma
    assert found.lost.sigma < 0.1 * volume
    assert abs(-found.net.value - volume) < 3.0 * found.net.sigma
    lost = found.changed < 0
    place = found.difference.with_heights(np.where(lost, found.difference.z, np.nan)).points()
    assert np.linalg.norm(place[:, :2].mean(axis=0) - [30.0, 35.0]) < 2.0
    # elsewhere some 5 % are beyond their 95 % bounds
    elsewhere_ = found.difference.measured & (found.changed == 0)
    beyond = found.significant_map.z[elsewhere_] != 0.0
    assert 0.01 < beyond.mean() < 0.12


@pytest.mark.slow
def test_pulls_of_the_volume_are_near_one():
    volume = -PIT.sum()
    pulls = []
    for seed in range(10):
        found = compare_surfaces(
            noisy(TRUTH, 10 + seed), elsewhere(noisy(TRUTH + PIT, 50 + seed)), "um", T
        )
        pulls.append((-found.net.value - volume) / found.net.sigma)
        pulls.append((found.lost.value - volume) / found.lost.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_error_bars_that_are_too_large_shrink_to_what_the_unchanged_part_shows():
    large = [
        replace(m, vertex_sigma=3.0 * m.vertex_sigma) for m in (noisy(TRUTH, 1), noisy(TRUTH, 2))
    ]
    found = compare_surfaces(*large, "um", T)
    assert found.registration.error_scale == pytest.approx(1.0 / 3.0, rel=0.25)
    spread = np.nanstd(found.difference.z)
    assert np.nanmedian(found.difference.sigma) == pytest.approx(spread, rel=0.4)


def test_surfaces_of_two_specimens_are_refused():
    other = rough(70, 80, 12.0, 20.0, seed=9)
    with pytest.raises(InputError, match=r"agree within their error bars"):
        compare_surfaces(
            sheet(10.0 * TRUTH, sigma=SIGMA), elsewhere(sheet(other, sigma=SIGMA)), "um", T
        )


def test_a_mesh_without_error_bars_is_refused():
    mesh = sheet(TRUTH)
    with pytest.raises(InputError, match="no error bars"):
        compare_surfaces(mesh, mesh, "um", T)


def test_the_correlation_area_is_that_of_the_filters_weights():
    weights = kernel(0.1, T)[1]
    assert correlation_area(T) == pytest.approx((0.1 / np.sum(weights**2)) ** 2, rel=1e-3)


def test_a_relief_is_found_again_where_it_was_moved_to():
    z = rough(60, 60, 8.0, 1.0, seed=4)
    moved = np.full_like(z, np.nan)
    moved[5:, :50] = z[:-5, 10:]
    score, shift = best_shift(z, moved)
    assert shift == (-5, 10)
    assert score > 0.95


def test_a_surface_that_has_not_changed_has_lost_nothing():
    found = compare_surfaces(noisy(TRUTH, 5), elsewhere(noisy(TRUTH, 6)), "um", T)
    assert found.lost.area == found.gained.area == 0.0
    assert abs(found.net.value) < 3.0 * found.net.sigma
    assert 0.0 < found.least_depth < 5.0 * SIGMA
