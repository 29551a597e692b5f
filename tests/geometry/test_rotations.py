import numpy as np

from semsfm_colmap.geometry.rotations import (
    depth_reversed,
    nearest_rotation,
    rotation_angle,
    rotation_from_vector,
    skew_matrix,
    vector_from_rotation,
)


def test_exponential_and_logarithm_are_inverse_from_tiny_to_large_angles():
    rng = np.random.default_rng(0)
    v = rng.normal(size=(50, 3))
    v *= np.geomspace(1e-9, 3.1, 50)[:, None] / np.linalg.norm(v, axis=1, keepdims=True)
    R = rotation_from_vector(v)
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3))
    assert np.allclose(np.linalg.det(R), 1.0)
    assert np.allclose(vector_from_rotation(R), v, atol=1e-12)
    assert np.allclose(rotation_angle(R), np.linalg.norm(v, axis=1), atol=1e-12)


def test_skew_matrix_is_the_cross_product():
    a, b = np.random.default_rng(1).normal(size=(2, 3))
    assert np.allclose(skew_matrix(a) @ b, np.cross(a, b))


def test_nearest_rotation_of_a_scaled_rotation_is_that_rotation():
    R = rotation_from_vector(np.array([0.3, -0.2, 1.0]))
    assert np.allclose(nearest_rotation(2.5 * R), R)
    assert np.linalg.det(nearest_rotation(-np.eye(3))) > 0


def test_depth_reversal_keeps_the_images_and_is_its_own_inverse():
    R = rotation_from_vector(np.array([[0.1, 0.7, -0.2]]))
    X = np.random.default_rng(2).normal(size=(10, 3))
    mirrored = X * [1.0, 1.0, -1.0]
    assert np.allclose((X @ R[0].T)[:, :2], (mirrored @ depth_reversed(R)[0].T)[:, :2])
    assert np.allclose(depth_reversed(depth_reversed(R)), R)
