from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.mesh_statistics import mesh_statistics
from tests.report.series import cube


def test_a_cube_has_its_area_box_and_no_open_edge():
    mesh = mesh_statistics(cube(side=3.0))
    assert mesh.num_components == 1
    assert mesh.num_open_edges == 0
    assert mesh.area_world2 == pytest.approx(54.0)
    assert mesh.bounding_box.size_world == (3.0, 3.0, 3.0)


def test_two_cubes_one_without_its_lid_are_two_components_with_four_open_edges():
    box = cube()
    vertices = np.concatenate([box.vertices, box.vertices + 5.0, [[99.0, 99.0, 99.0]]])
    faces = np.concatenate([box.faces, box.faces[2:] + 8])
    mesh = mesh_statistics(replace(box, vertices=vertices, faces=faces))
    assert mesh.num_components == 2
    assert mesh.num_open_edges == 4
    assert mesh.area_world2 == pytest.approx(11.0)
    assert mesh.largest_component_area_fraction == pytest.approx(6.0 / 11.0)
    # the vertex that no face uses does not count
    assert mesh.bounding_box.size_world == (6.0, 6.0, 6.0)


def test_a_mesh_without_a_face_has_no_box():
    mesh = mesh_statistics(replace(cube(), faces=np.zeros((0, 3), dtype=np.int64)))
    assert (mesh.num_vertices, mesh.num_faces, mesh.num_components) == (8, 0, 0)
    assert mesh.bounding_box is None
