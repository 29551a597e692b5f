"""Cavities and thin parts, against shapes with a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.io.open3d_rays import ray_scene
from semsfm_colmap.synthetic.primitives import Mesh, geodesic_sphere, grid_faces, merged
from semsfm_colmap.synthetic.scenes.base import Specimen
from semsfm_colmap.synthetic.surface import (
    convexity,
    openness,
    smoothed,
    thickness,
)
from semsfm_colmap.types import Float


def normals_of(specimen: Specimen) -> Float:
    return vertex_normals(specimen.vertices, specimen.faces)


def specimen_of(mesh: Mesh) -> Specimen:
    zeros = np.zeros(len(mesh[0]))
    return Specimen(vertices=mesh[0], faces=mesh[1], texture=zeros, label=zeros.astype(np.int64))


def escaping(mesh: Mesh) -> Float:
    specimen = specimen_of(mesh)
    scene = ray_scene(*mesh)
    return openness(specimen, normals_of(specimen), scene, np.random.default_rng(0))


def test_everything_escapes_from_a_convex_body() -> None:
    np.testing.assert_array_equal(escaping(geodesic_sphere(8)), 1.0)


def test_nothing_escapes_from_inside_a_small_closed_cavity() -> None:
    vertices, faces = geodesic_sphere(8)
    np.testing.assert_array_equal(escaping((0.1 * vertices, faces[:, ::-1])), 0.0)


def test_half_escapes_at_the_foot_of_a_high_wall() -> None:
    floor = np.array([[0, 0, 0], [0.01, 0, 0], [0.01, 0.01, 0], [0, 0.01, 0]], dtype=float)
    wall = np.array([[-0.005, -9, -9], [-0.005, 9, -9], [-0.005, 9, 9], [-0.005, -9, 9]])
    quad = np.array([[0, 2, 1], [0, 3, 2]])
    free = escaping(merged([(floor, quad), (wall, quad)]))[:4]
    # A wall without end takes half of a cosine distribution; 16 rays resolve 1 / 16.
    assert 0.5 - 2 / 16 <= free.min() <= free.max() <= 0.5 + 2 / 16


def test_the_thickness_of_a_plate_is_found_from_both_of_its_sides() -> None:
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    up = np.array([[0, 1, 2], [0, 2, 3]])
    small = 0.5 * square
    mesh = merged([(small, up), (square - np.array([0, 0, 0.3]), up[:, ::-1])])
    specimen = specimen_of(mesh)
    found = thickness(specimen, normals_of(specimen), ray_scene(*mesh))
    np.testing.assert_allclose(found[:4], 0.3, atol=1e-3)
    # From beyond the smaller side there is nothing to come out of.
    assert np.all(np.isinf(found[4:]))


def test_a_body_buried_in_another_does_not_make_it_thin() -> None:
    vertices, faces = geodesic_sphere(8)
    mesh = merged([(vertices, faces), (0.5 * vertices, faces)])
    specimen = specimen_of(mesh)
    found = thickness(specimen, normals_of(specimen), ray_scene(*mesh))
    num = len(vertices)
    assert np.all(np.isinf(found[:num]))
    np.testing.assert_allclose(found[num:], 1.0, rtol=0.02)


def test_smoothing_keeps_constants_and_lowers_a_peak() -> None:
    _, faces = geodesic_sphere(4)
    ones = np.ones(162)
    np.testing.assert_allclose(smoothed(ones, faces), 1.0)
    peak = np.zeros(162)
    peak[7] = 1.0
    assert smoothed(peak, faces)[7] == pytest.approx(1.0 / 3.0)


@pytest.mark.parametrize(("size", "side"), [(1.0, 1.0), (2.5, 1.0), (1.0, -1.0)])
def test_a_ball_stands_out_by_the_curvature_of_its_surface(size: float, side: float) -> None:
    vertices, faces = geodesic_sphere(40)
    mesh = (size * vertices, faces if side > 0 else faces[:, ::-1])
    specimen = specimen_of(mesh)
    found = convexity(specimen, normals_of(specimen), 0.1 * size)
    # radius / r in the limit of small radii; seen from inside it is a hollow.
    assert np.median(found) == pytest.approx(0.1 * side, rel=0.05)
    # Around the corners of the icosahedron triangles are smaller, and with them the neighbourhood.
    assert 0.05 < (side * found).min() < (side * found).max() < 0.15


def test_a_plane_neither_stands_out_nor_recedes() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij")
    vertices = np.stack([x, y, 0.3 * x], axis=-1).reshape(-1, 3)
    specimen = specimen_of((vertices, grid_faces(20, 20)))
    inner = np.s_[5:15, 5:15]
    found = convexity(specimen, normals_of(specimen), 2.0).reshape(20, 20)
    np.testing.assert_allclose(found[inner], 0.0, atol=1e-5)
