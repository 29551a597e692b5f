import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.studies.features.transfer import Transfer
from semsfm_colmap.types import OrthographicCameras

RADIUS = 2.0


def first_hit_of_a_sphere(origin, direction):
    """Nearest intersection with the sphere of RADIUS about the origin."""
    b = np.einsum("nk,nk->n", origin, direction)
    c = np.einsum("nk,nk->n", origin, origin) - RADIUS**2
    under = b**2 - c
    return np.where(under >= 0, -b - np.sqrt(np.maximum(under, 0)), np.inf)


@pytest.fixture
def sphere():
    angles = np.radians([0.0, 25.0])
    return Transfer(
        cameras=OrthographicCameras(
            cam_from_world=np.stack([rotation_from_vector([0, a, 0]) for a in angles]),
            scale_px_per_unit=np.array([100.0, 103.0]),
            translation_px=np.array([[320.0, 240.0], [318.0, 236.0]]),
            aspect=1.01,
            skew=0.002,
        ),
        first_hit=first_hit_of_a_sphere,
        radius=RADIUS,
    )


def front_points(sphere, image_idx, num=400):
    rng = np.random.default_rng(0)
    X = rng.normal(size=(num, 3))
    X *= RADIUS / np.linalg.norm(X, axis=1, keepdims=True)
    facing = X @ sphere.cameras.cam_from_world[image_idx].T
    return X[facing[:, 2] < -0.2 * RADIUS]


def test_points_are_lifted_to_where_they_came_from(sphere):
    X = front_points(sphere, 1)
    xy = sphere.cameras.project(X, np.ones(len(X), dtype=int))
    assert np.allclose(sphere.lift(1, xy), X, atol=1e-6)


def test_positions_are_predicted_in_the_other_image_where_it_sees_them(sphere):
    X = front_points(sphere, 0)
    i, j = np.zeros(len(X), dtype=int), np.ones(len(X), dtype=int)
    predicted = sphere.predict(0, 1, sphere.cameras.project(X, i))
    depth = X @ sphere.cameras.cam_from_world[1][2]
    seen = depth < -0.1 * RADIUS
    hidden = depth > 0.05 * RADIUS
    assert seen.sum() > 50
    assert hidden.sum() > 3
    assert np.allclose(predicted[seen], sphere.cameras.project(X, j)[seen], atol=1e-4)
    assert np.isnan(predicted[hidden]).all()


def test_beside_the_specimen_nothing_is_predicted(sphere):
    assert np.isnan(sphere.predict(0, 1, np.array([[20.0, 20.0]]))).all()


def test_the_viewing_angle_is_that_between_the_cameras(sphere):
    assert sphere.angle_deg(0, 1) == pytest.approx(25.0)
