"""Plane-induced affine maps against closed forms."""

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.warps import plane_induced_warp

FRONT = np.array([0.0, 0.0, -1.0])


def test_a_view_maps_onto_itself_whatever_the_normal():
    A = 1.3 * rotation_from_vector(np.array([0.2, 0.4, -0.1]))[:2]
    W = plane_induced_warp(A, A, np.array([0.3, 0.2, -0.9]))
    np.testing.assert_allclose(W, np.eye(2), atol=1e-12)


@pytest.mark.parametrize("angle", [-0.6, 0.1, 1.0])
def test_a_frontal_plane_shrinks_by_the_cosine_across_the_axis(angle):
    A = np.eye(3)[:2]
    B = rotation_from_vector(np.array([0.0, angle, 0.0]))[:2]
    np.testing.assert_allclose(
        plane_induced_warp(A, B, FRONT), np.diag([np.cos(angle), 1.0]), atol=1e-12
    )


def test_points_of_the_plane_move_as_the_warp_says():
    rng = np.random.default_rng(0)
    A, B = (s * rotation_from_vector(rng.normal(size=3) * 0.4)[:2] for s in (1.0, 1.2))
    normal = rng.normal(size=3)
    D = np.linalg.svd(normal[None])[2][1:].T @ rng.normal(size=(2, 5))  # in the plane
    W = plane_induced_warp(A, B, normal)
    np.testing.assert_allclose(W @ (A @ D), B @ D, atol=1e-12)


def test_stacks_of_planes_are_mapped_one_by_one():
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(2, 4, 2, 3))
    normals = rng.normal(size=(4, 3))
    stacked = plane_induced_warp(A, B, normals)
    for k in range(4):
        np.testing.assert_allclose(stacked[k], plane_induced_warp(A[k], B[k], normals[k]))


def test_a_plane_seen_edge_on_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        plane_induced_warp(np.eye(3)[:2], np.eye(3)[:2], np.array([1.0, 0.0, 0.0]))
