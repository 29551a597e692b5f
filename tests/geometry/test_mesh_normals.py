"""Normals of meshes with a closed form."""

import numpy as np

from semsfm_colmap.geometry.mesh_normals import (
    angle_weighted_normals,
    face_normals,
    vertex_normals,
)
from semsfm_colmap.synthetic.primitives import geodesic_sphere

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
FACES = np.array([t for a, b, c, d in QUADS for t in ([a, b, c], [a, c, d])])


def test_the_normals_of_faces_point_outside_and_have_twice_their_area():
    normal = face_normals(CUBE, FACES)
    assert np.all(np.einsum("fi,fi->f", normal, CUBE[FACES].mean(axis=1)) > 0)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 4.0)


def test_normals_of_a_sphere_are_its_radii():
    vertices, faces = geodesic_sphere(12)
    for normals in (vertex_normals(vertices, faces), angle_weighted_normals(vertices, faces)):
        assert np.sum(normals * vertices, axis=1).min() > 0.999


def test_the_angle_weighted_normal_of_a_cubes_corner_is_its_diagonal_however_it_is_cut():
    np.testing.assert_allclose(angle_weighted_normals(CUBE, FACES), CUBE / np.sqrt(3.0), atol=1e-12)


def test_a_vertex_without_faces_has_no_normal():
    vertices, faces = geodesic_sphere(1)
    vertices = np.concatenate([vertices, [[9.0, 9.0, 9.0]]])
    for normals in (vertex_normals(vertices, faces), angle_weighted_normals(vertices, faces)):
        np.testing.assert_array_equal(normals[-1], 0.0)
        np.testing.assert_allclose(np.linalg.norm(normals[:-1], axis=1), 1.0)
