from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.sizes import fits, quantities
from semsfm_colmap.metrology.sizes.quantities import (
    angle,
    area,
    closed_volume,
    distance,
    plane_angle,
    point_to_plane,
    profile,
    radius,
    step_height,
    times,
    volume_above,
)
from semsfm_colmap.synthetic.primitives import geodesic_sphere, grid_faces
from tests.metrology.sizes.builders import places_at

RNG = np.random.default_rng(0)
SQUARE = np.array([[x, y, 0.0] for x in range(5) for y in range(5)])
UP = np.array([0.0, 0.0, 1.0])


def on(points):
    return places_at(points, np.tile(UP, (len(np.atleast_2d(points)), 1)))


@pytest.fixture
def held_weights(monkeypatch):
    """The weights of strays are held: a gradient is one at the weights that were found."""
    for module in (fits, quantities):
        monkeypatch.setattr(module, "robust_weights", lambda r: np.ones(len(r)))


def assert_gradient(measure, *sets, rtol=1e-5, atol=1e-7):
    """The gradient of a quantity against finite differences over every coordinate."""
    quantity = measure(*sets)
    joined = np.concatenate([places.points for places in sets])
    size = np.cumsum([0] + [len(places) for places in sets])

    def value(points):
        moved = [
            replace(places, points=points[a:b])
            for places, a, b in zip(sets, size, size[1:], strict=False)
        ]
        return measure(*moved).value

    numeric = np.zeros_like(joined)
    for index in np.ndindex(joined.shape):
        step = np.zeros_like(joined)
        step[index] = 1e-5
        numeric[index] = (value(joined + step) - value(joined - step)) / 2e-5
    np.testing.assert_allclose(quantity.gradient, numeric, rtol=rtol, atol=atol)


def test_distance_and_angle_have_their_closed_forms():
    a, b, c = on([3.0, 0, 0]), on([0, 4.0, 0]), on([0.0, 0, 0])
    assert distance(a, b, "d").value == pytest.approx(5.0)
    assert angle(a, c, b, "w").value == pytest.approx(np.pi / 2)
    assert_gradient(lambda p, q: distance(p, q, "d"), a, b)
    d = on([1.0, 2.0, 0.7])
    assert_gradient(lambda p, q, r: angle(p, q, r, "w"), a, c, d)


def test_a_place_twice_is_no_distance_and_no_angle():
    a, b = on([1.0, 2.0, 3.0]), on([2.0, 2.0, 3.0])
    with pytest.raises(InputError, match="both places are one"):
        distance(a, a, "d")
    with pytest.raises(InputError, match="the corner is one of the ends"):
        angle(a, a, b, "w")


def test_the_angle_of_a_straight_line_is_not_certain():
    a, b, c = on([1.0, 0, 0]), on([-2.0, 0, 0]), on([0.0, 0, 0])
    straight = angle(a, c, b, "w")
    assert straight.value == pytest.approx(np.pi)
    bent = angle(on([1.0, 1e-3, 0]), c, b, "w")
    size = np.linalg.norm(straight.gradient, axis=1)
    np.testing.assert_allclose(size, np.linalg.norm(bent.gradient, axis=1), rtol=1e-3)


def test_a_step_has_its_height_whatever_its_tilt_and_its_strays():
    low, high = on(SQUARE), on(SQUARE + np.array([10.0, 1.0, 2.5]))
    assert step_height(low, high, "s").value == pytest.approx(2.5)
    assert step_height(high, low, "s").value == pytest.approx(-2.5)
    off = np.array(high.points)
    off[0, 2] += 3.0
    assert step_height(low, replace(high, points=off), "s").value == pytest.approx(2.5, abs=1e-3)


@pytest.mark.usefixtures("held_weights")
def test_the_height_of_a_step_follows_every_point():
    low, high = on(SQUARE), on(SQUARE + np.array([10.0, 1.0, 2.5]))
    assert_gradient(lambda a, b: step_height(a, b, "s"), low, high, atol=1e-4)


def test_moving_all_outward_moves_the_radius_and_not_the_step():
    d, _ = geodesic_sphere(4)
    ball = places_at(3.0 * d[d[:, 2] > 0.2], d[d[:, 2] > 0.2])
    found = radius("sphere", ball, "r")
    along = np.einsum("ki,ki->k", found.gradient, ball.normals)
    assert along.sum() == pytest.approx(1.0)
    step = step_height(on(SQUARE), on(SQUARE + np.array([10.0, 0.0, 2.5])), "s")
    along = np.einsum("ki,ki->k", step.gradient, step.places.normals)
    assert along.sum() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.usefixtures("held_weights")
def test_angles_between_planes_and_heights_over_them():
    slope = SQUARE @ np.array([[np.cos(0.5), 0, np.sin(0.5)], [0, 1, 0], [0, 0, 1]])
    flat, tilted = on(SQUARE), on(slope)
    assert plane_angle(flat, tilted, "w").value == pytest.approx(0.5)
    assert_gradient(lambda a, b: plane_angle(a, b, "w"), flat, tilted, atol=1e-4)
    top = on([9.0, 1.0, 2.0])
    assert point_to_plane(top, flat, "h").value == pytest.approx(2.0)
    assert_gradient(lambda a, b: point_to_plane(a, b, "h"), top, flat, atol=1e-4)


def test_area_and_volume_of_a_sphere():
    d, faces = geodesic_sphere(24)
    ball = places_at(2.0 * d, d)
    whole = np.ones(len(faces))
    assert area(ball, faces, whole, "a").value == pytest.approx(4 * np.pi * 4, rel=2e-3)
    volume = closed_volume(ball, faces, "v")
    assert volume.value == pytest.approx(4 / 3 * np.pi * 8, rel=3e-3)
    # all outward by e: dV = A e
    along = np.einsum("ki,ki->k", volume.gradient, ball.normals)
    assert along.sum() == pytest.approx(4 * np.pi * 4, rel=3e-3)


@pytest.mark.usefixtures("held_weights")
def test_areas_and_volumes_follow_every_point():
    d, faces = geodesic_sphere(1)
    ball = places_at(d + 0.05 * RNG.normal(size=d.shape), d)
    share = RNG.uniform(0.3, 1.0, len(faces))
    assert_gradient(lambda p: area(p, faces, share, "a"), ball)
    assert_gradient(lambda p: closed_volume(p, faces, "v"), ball)
    base = on(SQUARE)
    assert_gradient(lambda p, q: volume_above(p, faces, share, q, "v"), ball, base, atol=1e-4)


def test_the_volume_above_a_plane_is_that_of_a_box():
    lid = on(SQUARE + np.array([0.0, 0.0, 1.5]))
    faces = grid_faces(5, 5)
    found = volume_above(lid, faces, np.ones(len(faces)), on(SQUARE - np.array([7.0, 0, 0])), "v")
    assert abs(found.value) == pytest.approx(16 * 1.5)


def test_an_open_part_encloses_no_volume():
    d, faces = geodesic_sphere(3)
    with pytest.raises(InputError, match=r"open \(3 open edges\) and encloses no volume: mesh it"):
        closed_volume(places_at(d, d), faces[1:], "grain")


def test_a_region_without_faces_has_no_area():
    with pytest.raises(InputError, match="holds no face"):
        area(on(SQUARE), np.zeros((0, 3), dtype=np.int64), np.zeros(0), "spot")


def test_a_step_of_two_points_is_refused():
    with pytest.raises(InputError, match="a region holds 2 points"):
        step_height(on(SQUARE[:2]), on(SQUARE), "s")


def test_a_ratio_of_lengths_has_the_gradients_of_both():
    a, b, c = on([0.0, 0, 0]), on([3.0, 0, 0]), on([3.0, 4.0, 0])
    half = times(distance(a, b, "p"), distance(b, c, "q"), -1.0)
    assert half.value == pytest.approx(0.75)
    assert_gradient(
        lambda p, q, r, s: times(distance(p, q, "p"), distance(r, s, "q"), -1.0), a, b, b, c
    )


def test_heights_of_a_profile_are_over_the_line_toward_the_viewer():
    v = np.array([0.0, 0.0, 1.0])
    ends = places_at([0.0, 0, 0]), places_at([10.0, 0, -1.0])
    along = np.linspace(0.0, 1.0, 5)
    bump = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    points = np.stack([10 * along, 0 * along, -along - bump], axis=1)
    found = profile(ends, places_at(points), v)
    lift = np.array([q.value for q in found])
    np.testing.assert_allclose(lift, bump * 10 / np.hypot(10, 1), atol=1e-12)
    # at the ends a sample is the end itself
    np.testing.assert_allclose(found[0].gradient.sum(axis=0), 0.0, atol=1e-12)
