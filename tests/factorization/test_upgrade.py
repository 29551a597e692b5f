import numpy as np
import pytest

from semsfm_colmap.factorization.upgrade import upgrade_to_euclidean
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import AffineModel
from tests.alignment import best_hand_errors_deg


def affine_model(R, scale, seed=0):
    """Cameras and points in a random affine frame."""
    rng = np.random.default_rng(seed)
    A = scale[:, None, None] * R[:, :2]
    X = rng.normal(size=(50, 3))
    Q = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    return AffineModel(A=A @ Q, t=rng.normal(size=(len(A), 2)), X=np.linalg.solve(Q, X.T).T), A, X


def turn(angles_deg, wobble=0.02, seed=1):
    angles = np.deg2rad(np.asarray(angles_deg, dtype=float))
    v = np.random.default_rng(seed).normal(scale=wobble, size=(len(angles), 3))
    return rotation_from_vector(v) @ rotation_from_vector(angles[:, None] * [0.0, 1.0, 0.0])


@pytest.mark.parametrize("angles", [[0, 10, 20], [0, 3, 6, 9], np.linspace(0, 340, 30)])
def test_exact_affine_cameras_are_upgraded_exactly(angles):
    R = turn(angles)
    model, A, X = affine_model(R, np.ones(len(R)))
    found = upgrade_to_euclidean(model, scale_sigma=0.001)
    cameras, points = found.value.cameras, found.value.points
    assert best_hand_errors_deg(cameras.cam_from_world, R).max() < 1e-3
    assert np.allclose(cameras.scale_px_per_unit, 1.0, atol=1e-5)
    # the images stay what they were
    before = np.einsum("mij,nj->mni", A, X)
    after = np.einsum("mij,nj->mni", cameras.projection, points)
    assert np.allclose(before, after, atol=1e-4)


def test_magnifications_that_differ_are_found():
    R, scale = turn(np.linspace(0, 90, 8)), 1.0 + 0.05 * np.sin(np.arange(8))
    model, _, _ = affine_model(R, scale)
    cameras = upgrade_to_euclidean(model, scale_sigma=0.2).value.cameras
    relative = cameras.scale_px_per_unit / scale
    assert np.allclose(relative / relative.mean(), 1.0, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "R"),
    [
        ("two views", turn([0, 20])),
        ("all tilts equal", turn([7, 7, 7, 7], wobble=0.0)),
        (
            "in-plane rotation only",
            rotation_from_vector(np.array([[0, 0, a] for a in (0, 0.3, 0.8)])),
        ),
    ],
)
def test_degenerate_views_are_said_to_be(name, R):
    model, _, _ = affine_model(R, np.ones(len(R)))
    found = upgrade_to_euclidean(model, scale_sigma=0.001)
    assert found.status == "underdetermined", name
    assert found.value is None
    assert found.diagnostics["num_free"] >= 1


def test_the_metric_is_positive_definite_even_for_inconsistent_cameras():
    rng = np.random.default_rng(4)
    model = AffineModel(
        A=rng.normal(size=(5, 2, 3)), t=np.zeros((5, 2)), X=rng.normal(size=(20, 3))
    )
    found = upgrade_to_euclidean(model, scale_sigma=0.001)
    cameras, points = found.value.cameras, found.value.points
    assert np.isfinite(points).all()
    assert np.allclose(np.linalg.det(cameras.cam_from_world), 1.0)
