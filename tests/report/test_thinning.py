from dataclasses import replace

import numpy as np

from semsfm_colmap.report.thinning import even_subset, thin_mesh, vertex_colors
from tests.report.series import cube, sphere


def test_thinning_a_mesh_stays_within_a_cell_of_the_surface():
    mesh = sphere()
    thin = thin_mesh(mesh, 5000)
    assert 2500 < len(thin.faces) <= 5000
    radius = np.linalg.norm(thin.vertices, axis=1)
    # 5000 faces on a sphere of area 4 pi are 0.07 long
    assert np.all(np.abs(radius - 1.0) < 0.02)
    assert thin.faces.max() == len(thin.vertices) - 1


def test_thinning_a_mesh_keeps_its_faces_turned_outward():
    thin = thin_mesh(sphere(), 5000)
    corner = thin.vertices[thin.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert np.mean(np.einsum("ij,ij->i", normal, corner.mean(axis=1)) > 0.0) > 0.99


def test_a_small_mesh_is_left_as_it_is():
    thin = thin_mesh(cube(), 12)
    np.testing.assert_array_equal(thin.faces, cube().faces)


def test_vertex_colours_come_from_the_texture():
    texture = np.zeros((2, 2, 3), dtype=np.uint8)
    texture[0, 1] = (10, 20, 30)
    uv = np.tile([0.75, 0.75], (12, 3, 1))
    colors = vertex_colors(replace(cube(), uv=uv, texture=texture))
    np.testing.assert_array_equal(colors, np.tile([10, 20, 30], (8, 1)))


def test_an_even_subset_is_spread_evenly():
    idx = even_subset(100_000, 1000)
    assert len(idx) == len(np.unique(idx)) == 1000
    counts = np.histogram(idx, bins=20, range=(0, 100_000))[0]
    assert counts.min() >= 45
    assert counts.max() <= 55
    np.testing.assert_array_equal(even_subset(5, 10), np.arange(5))
