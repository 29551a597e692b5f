"""Error bars of a cloud at the vertices of a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.mesh.vertex_sigma import sigma_at, with_vertex_sigma
from semsfm_colmap.types import PointCloud, TriangleMesh


def cloud(sigma: float | None = 0.3) -> PointCloud:
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(400)])
    return PointCloud(points=points, sigma=None if sigma is None else np.full(400, sigma))


def test_a_vertex_near_the_points_is_as_uncertain_as_they_are() -> None:
    np.testing.assert_allclose(sigma_at(np.array([[5.0, 5.0, 0.0], [7.5, 3.2, 0.4]]), cloud()), 0.3)


def test_a_vertex_far_from_all_points_is_less_certain_the_farther_it_is() -> None:
    near, far = sigma_at(np.array([[10.0, 10.0, 8.0], [10.0, 10.0, 16.0]]), cloud())
    assert 0.3 < near < far
    # eight more units of distance, half of them a deviation
    assert far - near == pytest.approx(4.0, rel=0.02)


def test_a_change_of_sigma_is_followed() -> None:
    points = cloud().points
    step = PointCloud(points=points, sigma=np.where(points[:, 0] < 10, 0.1, 1.0))
    left, right = sigma_at(np.array([[2.0, 10.0, 0.0], [17.0, 10.0, 0.0]]), step)
    np.testing.assert_allclose([left, right], [0.1, 1.0])


def test_clouds_without_error_bars_and_of_few_points_give_what_they_have() -> None:
    mesh = TriangleMesh(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    assert with_vertex_sigma(mesh, cloud(None)) is mesh
    assert with_vertex_sigma(mesh, PointCloud(points=np.zeros((0, 3)))) is mesh
    one = PointCloud(points=np.eye(3), sigma=np.full(3, 0.2))
    np.testing.assert_allclose(with_vertex_sigma(mesh, one).vertex_sigma, 0.2)
