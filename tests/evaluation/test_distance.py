"""Signed distances and visibility against bodies with a closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.primitives import geodesic_sphere
from semsfm_colmap.types import Float, OrthographicCameras, TriangleMesh

SIZE = (400, 300)


def box() -> TriangleMesh:
    """The cube -1..1, faces outward, each of two triangles."""
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])]
    return TriangleMesh(vertices=corner, faces=np.array(faces))


def box_distance(points: Float) -> Float:
    """Signed distance to the cube -1..1 in closed form."""
    q = np.abs(points) - 1.0
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
    return np.asarray(outside + np.minimum(q.max(axis=1), 0.0))


def sheet() -> TriangleMesh:
    """An open square in the plane z = 0 that faces the viewer at -z."""
    vertices = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    return TriangleMesh(vertices=vertices, faces=np.array([[0, 2, 1], [0, 3, 2]]))


def flipped(mesh: TriangleMesh) -> TriangleMesh:
    return replace(mesh, faces=mesh.faces[:, ::-1])


def cameras(angles_deg: tuple[float, ...] = (0.0,)) -> OrthographicCameras:
    turn = np.radians(angles_deg)[:, None] * [0.0, 1.0, 0.0]
    num = len(angles_deg)
    return OrthographicCameras(
        cam_from_world=rotation_from_vector(turn),
        scale_px_per_unit=np.full(num, 100.0),
        translation_px=np.tile([200.0, 150.0], (num, 1)),
    )


def test_signed_distances_to_a_cube_are_those_of_the_formula() -> None:
    # Around corners and edges, inside and out, where the normal of one face would mislead.
    points = np.random.default_rng(0).uniform(-1.8, 1.8, (4000, 3))
    np.testing.assert_allclose(
        Surface(box()).signed_distance(points), box_distance(points), atol=1e-5
    )


def test_a_point_on_the_surface_has_distance_zero() -> None:
    mesh = box()
    np.testing.assert_allclose(Surface(mesh).signed_distance(mesh.vertices), 0.0, atol=1e-6)


def test_an_open_sheet_has_two_sides() -> None:
    surface = Surface(sheet())
    points = np.array([[0.2, 0.3, -0.5], [0.2, 0.3, 0.5], [1.5, 0.0, 0.0]])
    np.testing.assert_allclose(np.abs(surface.signed_distance(points)), 0.5, atol=1e-6)
    np.testing.assert_allclose(surface.signed_distance(points[:2]), [0.5, -0.5], atol=1e-6)


@pytest.mark.parametrize("mesh", [box(), sheet()], ids=["box", "sheet"])
def test_the_seen_side_is_the_outside_whatever_way_the_faces_turn(mesh: TriangleMesh) -> None:
    points = np.array([[0.1, 0.2, -1.5], [0.1, 0.2, -1.2]])
    expected = Surface(mesh).signed_distance(points)
    assert np.all(expected > 0)
    wrong = Surface(flipped(mesh))
    np.testing.assert_allclose(wrong.signed_distance(points), -expected)
    wrong.orient(cameras(), SIZE)
    np.testing.assert_allclose(wrong.signed_distance(points), expected)


def test_orienting_a_surface_that_no_camera_sees_changes_nothing() -> None:
    surface = Surface(box())
    away = replace(cameras(), translation_px=np.array([[9000.0, 9000.0]]))
    surface.orient(away, SIZE)
    assert surface.signed_distance(np.array([[0.0, 0.0, -2.0]]))[0] == pytest.approx(1.0)


def test_no_points_have_no_distances() -> None:
    assert Surface(box()).signed_distance(np.zeros((0, 3))).shape == (0,)


def test_the_visible_part_of_a_ball_is_the_half_toward_the_viewer() -> None:
    vertices, faces = geodesic_sphere(20)
    seen = Surface(TriangleMesh(vertices=vertices, faces=faces)).visible_samples(
        cameras(), SIZE, 4000
    )
    assert 0.47 < len(seen) / 4000 < 0.5
    assert seen[:, 2].max() < 0.01


def test_more_views_see_more() -> None:
    vertices, faces = geodesic_sphere(20)
    surface = Surface(TriangleMesh(vertices=vertices, faces=faces))
    share = [
        len(surface.visible_samples(cameras(angles), SIZE, 4000)) / 4000
        for angles in ((0.0,), (0.0, 90.0), (0.0, 180.0))
    ]
    # A lune of 90 degrees more is a quarter of the ball more.
    np.testing.assert_allclose(share, [0.5, 0.75, 1.0], atol=0.03)


def test_what_lies_outside_of_the_image_is_not_seen() -> None:
    vertices, faces = geodesic_sphere(20)
    surface = Surface(TriangleMesh(vertices=vertices, faces=faces))
    left = surface.visible_samples(cameras(), (200, 300), 4000)
    assert left[:, 0].max() < 1e-12
    assert 0.23 < len(left) / 4000 < 0.26


def test_what_is_hidden_by_another_body_is_not_seen() -> None:
    vertices, faces = geodesic_sphere(20)
    small, big = 0.5 * vertices + [0.0, 0.0, 3.0], vertices
    both = TriangleMesh(
        vertices=np.concatenate([big, small]),
        faces=np.concatenate([faces, faces + len(vertices)]),
    )
    seen = Surface(both).visible_samples(cameras(), SIZE, 4000)
    assert seen[:, 2].max() < 0.01
    from_behind = Surface(both).visible_samples(cameras((180.0,)), SIZE, 4000)
    assert np.any(np.linalg.norm(from_behind - [0.0, 0.0, 3.0], axis=1) < 0.51)


def test_every_camera_is_told_apart_and_the_views_of_a_point_are_counted() -> None:
    vertices, faces = geodesic_sphere(20)
    surface = Surface(TriangleMesh(vertices=vertices, faces=faces))
    turning = cameras((7.0, 47.0, 87.0))
    points, normals = surface.samples(3000)
    seen = surface.visibility(points, normals, turning, SIZE)
    # on a ball a camera sees what faces it: half of it each
    facing = normals @ turning.viewing_direction.T < 0
    np.testing.assert_array_equal(seen, facing)
    np.testing.assert_allclose(seen.mean(axis=0), 0.5, atol=0.01)
    # lunes between the half-balls: 100 of 360 degrees are seen by all three, 260 by any
    all_three = surface.visible_samples(turning, SIZE, 3000, min_views=3)
    assert len(all_three) / 3000 == pytest.approx(100 / 360, abs=0.01)
    assert len(surface.visible_samples(turning, SIZE, 3000)) / 3000 == pytest.approx(
        260 / 360, abs=0.01
    )


def test_a_ball_is_open_all_around_and_as_thick_as_its_diameter() -> None:
    vertices, faces = geodesic_sphere(20)
    surface = Surface(TriangleMesh(vertices=vertices, faces=faces))
    points, normals = surface.samples(500)
    directions = np.random.default_rng(0).normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_array_equal(surface.openings(points, normals, directions), 1.0)
    np.testing.assert_allclose(surface.thickness(points, normals), 2.0, atol=0.01)


def test_a_sheet_below_a_roof_is_closed_above_and_has_no_other_side() -> None:
    roof = sheet()
    wide = np.concatenate([roof.vertices, roof.vertices * 100.0 + [0.0, 0.0, -1.0]])
    faces = np.concatenate([roof.faces, roof.faces + 4])
    surface = Surface(TriangleMesh(vertices=wide, faces=faces))
    below, up = np.array([[0.1, 0.2, 0.0]]), np.array([[0.0, 0.0, -1.0]])
    steep = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(surface.openings(below, up, steep), 0.0)
    assert np.isinf(surface.thickness(below, up)).all()
