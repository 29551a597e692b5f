from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.metrology.heights.height_map import height_map_of_mesh, on_grid
from semsfm_colmap.metrology.heights.height_map_options import HeightMapOptions
from semsfm_colmap.types import TriangleMesh
from tests.metrology.heights.surfaces import rough, sheet, sphere
from tests.oracles import areal as oracle

UP = np.array([0.0, 0.0, 1.0])


def test_a_sheet_of_heights_comes_back_on_its_own_grid():
    z = rough(30, 40, 6.0, 1.0, seed=1)
    found = height_map_of_mesh(sheet(z), "um", axis=UP, spacing=1.0)
    assert found.z.shape == z.shape
    np.testing.assert_allclose(found.z + found.origin[2], z, atol=1e-9)
    assert found.overhang_share == 0.0


def test_heights_are_those_of_the_triangle_above_each_node():
    rng = np.random.default_rng(3)
    corner = rng.uniform(0.0, 9.0, size=(12, 3, 3))
    mesh = TriangleMesh(
        vertices=corner.reshape(-1, 3), faces=np.arange(36, dtype=np.int64).reshape(-1, 3)
    )
    found = on_grid(mesh, "um", np.zeros(3), np.eye(3), (1.0, 1.0), (10, 10))
    np.testing.assert_allclose(found.z, oracle.topmost(corner, 10, 10), atol=1e-9)


def test_the_plane_of_a_turned_surface_is_found_and_its_cells_lie_on_it():
    z = rough(60, 80, 6.0, 0.5, seed=2)
    z[10:16, 10:16] -= 30.0  # a pit
    flat = sheet(z, sigma=0.1)
    R = rotation_from_vector(np.array([[0.4, -0.3, 0.2]]))[0]
    turned = replace(flat, vertices=flat.vertices @ R.T)
    found = height_map_of_mesh(turned, "um")
    assert found.axes[2] @ R[:, 2] == pytest.approx(1.0, abs=1e-3)
    assert np.linalg.det(found.axes) == pytest.approx(1.0)
    back = found.points() @ R
    # cells lie on triangles: between the heights of their corners
    inside = (back[:, 0] < 79) & (back[:, 1] < 59)
    r, c = back[inside, 1].astype(int), back[inside, 0].astype(int)
    corner = np.stack([z[r, c], z[r + 1, c], z[r, c + 1], z[r + 1, c + 1]])
    assert np.all(back[inside, 2] <= corner.max(axis=0) + 1e-6)
    assert np.all(back[inside, 2] >= corner.min(axis=0) - 1e-6)


def test_the_error_along_the_vertical_grows_with_the_slope():
    x = np.broadcast_to(np.arange(40.0), (30, 40))
    found = height_map_of_mesh(sheet(x * np.tan(np.radians(60.0)), sigma=0.2), "um", axis=UP)
    np.testing.assert_allclose(found.sigma[found.measured], 0.4, rtol=1e-6)


def test_faces_that_close_a_hole_are_a_hole():
    mesh = sheet(np.zeros((30, 40)))
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    filled = np.linalg.norm(centre[:, :2] - [20.0, 15.0], axis=1) < 5.0
    found = height_map_of_mesh(replace(mesh, face_filled=filled), "um", axis=UP, spacing=1.0)
    assert np.isnan(found.z[15, 20])
    assert np.isfinite(found.z[2, 2])
    assert 0.03 < found.hole_share < 0.1


def test_an_overhang_takes_the_topmost_and_is_said():
    low, high = sheet(np.zeros((30, 40))), sheet(np.full((6, 30), 4.0))
    both = TriangleMesh(
        vertices=np.concatenate([low.vertices, high.vertices]),
        faces=np.concatenate([low.faces, high.faces + len(low.vertices)]),
    )
    found = height_map_of_mesh(both, "um", axis=UP, spacing=1.0)
    assert found.z[3, 3] - found.z[20, 20] == pytest.approx(4.0)
    assert found.overhang_share == pytest.approx(6 * 30 / (30 * 40), abs=0.01)


def test_a_closed_body_is_refused_with_what_to_do():
    with pytest.raises(InputError, match=r"closed or overhanging body.*--region"):
        height_map_of_mesh(sphere(20.0), "um", axis=UP)


def test_too_few_cells_are_refused():
    with pytest.raises(InputError, match="measured cells"):
        height_map_of_mesh(sheet(np.zeros((8, 40))), "um", axis=UP, spacing=1.0)


def test_a_surface_on_edge_is_refused():
    with pytest.raises(InputError, match="stands upright"):
        height_map_of_mesh(sheet(np.zeros((30, 30))), "um", axis=np.array([1.0, 0.0, 0.0]))


def test_a_surface_that_nobody_saw_is_refused():
    mesh = sheet(np.zeros((30, 30)))
    with pytest.raises(InputError, match="no faces that were seen"):
        height_map_of_mesh(replace(mesh, face_filled=np.ones(len(mesh.faces), dtype=bool)), "um")


def test_a_grid_of_too_many_cells_is_refused():
    with pytest.raises(InputError, match="too large"):
        height_map_of_mesh(sheet(np.zeros((30, 30))), "um", axis=UP, spacing=1e-4)


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan")])
def test_a_spacing_that_is_no_length_is_refused(spacing):
    with pytest.raises(UsageError, match="cells are wider than 0"):
        height_map_of_mesh(sheet(np.zeros((30, 30))), "um", axis=UP, spacing=spacing)


@pytest.mark.parametrize(("name", "value"), [("num_draws", 1), ("pixel_size_sigma", -0.1)])
def test_options_without_a_meaning_are_refused(name, value):
    with pytest.raises(UsageError, match=name):
        HeightMapOptions(**{name: value})
