import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.metrology.sizes.fits import (
    Circle,
    Cylinder,
    Plane,
    Sphere,
    across,
    fit,
    turned,
)

RNG = np.random.default_rng
TURN = rotation_from_vector(np.array([0.4, -0.7, 0.3]))
SHIFT = np.array([5.0, -3.0, 11.0])


def patch(kind, num, rng):
    """Points and outward normals on a part of a feature of radius 3, anywhere in space."""
    a, b = rng.uniform(-0.9, 0.9, (2, num))
    o = np.zeros(num)
    if kind is Plane:
        local, n = np.stack([3 * a, 2 * b, o], 1), np.tile([0.0, 0.0, 1.0], (num, 1))
    elif kind is Sphere:
        n = np.stack([np.sin(a), np.sin(b) * np.cos(a), np.cos(b) * np.cos(a)], 1)
        local = 3.0 * n
    elif kind is Cylinder:
        n = np.stack([np.sin(a), o, np.cos(a)], 1)
        local = 3.0 * n + np.stack([o, 4 * b, o], 1)
    else:
        local = 3.0 * np.stack([np.cos(3 * a), np.sin(3 * a), o], 1)
        n = np.tile([0.0, 0.0, 1.0], (num, 1))
    return local @ TURN.T + SHIFT, n @ TURN.T


KINDS = [Plane, Sphere, Cylinder, Circle]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("robust", [False, True])
def test_points_of_a_feature_give_it_exactly(kind, robust):
    points, normals = patch(kind, 60, RNG(1))
    found = fit(kind, points, normals, robust=robust)
    assert found.rms < 1e-9
    feature = found.feature
    if kind is not Plane:
        assert feature.radius == pytest.approx(3.0, abs=1e-9)
    if kind in (Sphere, Circle):
        np.testing.assert_allclose(feature.centre, SHIFT, atol=1e-8)
    axis = {Plane: "normal", Circle: "normal", Cylinder: "axis"}.get(kind)
    if axis is not None:
        along = TURN[:, 1] if kind is Cylinder else TURN[:, 2]
        assert abs(getattr(feature, axis) @ along) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_distances_have_the_derivatives_that_are_stated(kind):
    points, normals = patch(kind, 12, RNG(2))
    points = points + 0.05 * RNG(3).normal(size=points.shape)
    feature = kind.start(points, normals)
    J = feature.jacobian(points)
    step = 1e-6
    for p in range(J.shape[2]):
        e = np.zeros(J.shape[2])
        e[p] = step
        numeric = (
            feature.moved(e).distances(points)[0] - feature.moved(-e).distances(points)[0]
        ) / (2 * step)
        np.testing.assert_allclose(J[:, :, p], numeric, atol=1e-6)
    _, D = feature.distances(points)
    for i in range(3):
        e = step * np.eye(3)[i]
        numeric = (feature.distances(points + e)[0] - feature.distances(points - e)[0]) / (2 * step)
        np.testing.assert_allclose(D[:, :, i], numeric, atol=1e-6)


@pytest.mark.parametrize("kind", [Sphere, Cylinder, Circle])
def test_the_radius_scatters_as_its_response_says(kind):
    rng = RNG(4)
    points, normals = patch(kind, 40, rng)
    sigma = 0.01
    response = fit(kind, points, normals, robust=False).response[-1]
    told = sigma * np.linalg.norm(response)
    radii = [
        fit(
            kind, points + sigma * rng.normal(size=points.shape), normals, robust=False
        ).feature.radius
        for _ in range(400)
    ]
    assert np.std(radii) == pytest.approx(told, rel=0.12)
    assert np.mean(radii) == pytest.approx(3.0, abs=4 * told / 20 + 0.02 * sigma * 3)


def test_the_height_of_a_plane_scatters_as_its_response_says():
    rng = RNG(5)
    points, normals = patch(Plane, 40, rng)
    sigma = 0.01
    found = fit(Plane, points, normals, robust=False)
    away = SHIFT + 4.0 * TURN[:, 0] - found.feature.centre
    gradient = np.einsum("p,pki->ki", across(found.feature.normal) @ away, found.response[:2])
    gradient -= found.response[2]
    heights = []
    for _ in range(400):
        plane = fit(
            Plane, points + sigma * rng.normal(size=points.shape), normals, robust=False
        ).feature
        heights.append((SHIFT + 4.0 * TURN[:, 0] - plane.centre) @ plane.normal)
    assert np.std(heights) == pytest.approx(sigma * np.linalg.norm(gradient), rel=0.12)


def test_strays_do_not_pull_a_robust_fit():
    points, normals = patch(Sphere, 300, RNG(6))
    points = points + 0.002 * RNG(7).normal(size=points.shape)
    points[:20] += 0.5 * normals[:20]
    plain = fit(Sphere, points, normals, robust=False).feature.radius
    robust = fit(Sphere, points, normals).feature.radius
    assert abs(robust - 3.0) < 0.01 < abs(plain - 3.0)


def test_the_scatter_about_a_fit_is_that_of_the_points():
    points, normals = patch(Plane, 2000, RNG(8))
    noisy = points + 0.02 * RNG(9).normal(size=points.shape)
    assert fit(Plane, noisy, normals).scatter == pytest.approx(0.02, rel=0.08)


def test_the_scatter_tells_how_a_robust_mean_scatters_whatever_its_tails():
    rng = RNG(10)
    for draw in (rng.normal, lambda size: rng.standard_t(3, size)):
        heights, told = [], []
        for _ in range(300):
            points, normals = patch(Plane, 80, rng)
            noisy = points + 0.01 * draw(size=(80, 1)) * normals
            found = fit(Plane, noisy, normals)
            middle = points.mean(axis=0) - found.feature.centre
            heights.append(middle @ found.feature.normal)
            told.append(found.scatter * np.linalg.norm(found.response[2]))
        assert np.std(heights) == pytest.approx(np.mean(told), rel=0.15)


def test_too_few_points_are_said():
    points, normals = patch(Sphere, 3, RNG(1))
    with pytest.raises(InputError, match="cap holds 3 points of the surface, but a sphere needs 4"):
        fit(Sphere, points, normals, what="cap")


@pytest.mark.parametrize("kind", [Sphere, Cylinder])
def test_a_flat_region_has_no_radius(kind):
    points, normals = patch(Plane, 50, RNG(1))
    with pytest.raises(InputError, match="does not determine a"):
        fit(kind, points, normals)


def test_points_on_a_line_are_no_plane():
    line = np.linspace(0.0, 1.0, 20)[:, None] * np.array([1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="does not determine a plane"):
        fit(Plane, line, np.tile([0.0, 0.0, 1.0], (20, 1)))


def test_a_direction_is_turned_across_itself():
    n = np.array([0.0, 0.6, 0.8])
    e = across(n)
    np.testing.assert_allclose(e @ n, 0.0, atol=1e-15)
    np.testing.assert_allclose(e @ e.T, np.eye(2), atol=1e-15)
    moved = turned(n, np.array([1e-5, 2e-5]))
    np.testing.assert_allclose(e @ moved, [1e-5, 2e-5], rtol=1e-6)
