"""Local planes of a depth map, against least squares pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.types import Array

RIDGE = 0.1


def plane_at(depth: Array, weight: Array, y: int, x: int, radius: int, tolerance: float) -> Array:
    """The same by the book: weighted least squares with a ridge on the centred places."""
    rows = []
    for v in range(max(0, y - radius), min(depth.shape[0], y + radius + 1)):
        for u in range(max(0, x - radius), min(depth.shape[1], x + radius + 1)):
            dz = float(depth[v, u]) - float(depth[y, x])
            if abs(dz) <= tolerance * (1.0 + np.hypot(u - x, v - y)):
                rows.append((u - x, v - y, dz, weight[v, u]))
    place, dz, w = np.array(rows)[:, :2], np.array(rows)[:, 2], np.array(rows)[:, 3]
    if not w.sum() > 0:
        return np.full(3, np.nan)
    w = w / w.sum()
    centred = place - w @ place
    normal = centred.T @ (w[:, None] * centred) + RIDGE * np.eye(2)
    slope = np.linalg.solve(normal, centred.T @ (w * (dz - w @ dz)))
    return np.array([depth[y, x] + w @ dz - slope @ (w @ place), *slope])


@pytest.mark.parametrize("width", [7, 300, 530])
def test_local_planes_are_weighted_least_squares_of_what_is_near(width: int) -> None:
    rng = np.random.default_rng(width)
    depth = rng.normal(0.0, 1.0, (9, width)).astype(np.float32)
    depth[:, width // 3 :] += 8.0
    depth[rng.random(depth.shape) < 0.2] = np.nan
    weight = rng.random(depth.shape).astype(np.float32)
    weight[rng.random(depth.shape) < 0.3] = 0.0
    found = local_planes(depth, weight, 3, 1.0)
    for y in (0, 4, 8):
        for x in range(0, width, 1 if width < 20 else 17):
            if np.isfinite(depth[y, x]):
                expected = plane_at(depth, weight, y, x, 3, 1.0)
                np.testing.assert_allclose(found[:, y, x], expected, rtol=2e-3, atol=2e-3)
            else:
                assert np.isnan(found[:, y, x]).all()


def test_local_planes_keep_to_the_surface_of_the_centre() -> None:
    y, x = np.mgrid[0:20, 0:20].astype(np.float32)
    depth = 0.1 * x - 0.05 * y + 3.0
    depth[:, 10:] += 50.0
    depth[3, 3] = np.nan
    z, p, q = local_planes(depth, np.ones_like(depth), 3, 0.5)
    known = np.isfinite(depth)
    assert np.isnan(z[3, 3])
    inner = known & (np.abs(x - 9.5) < 5) & (np.abs(y - 9.5) < 5)
    np.testing.assert_allclose(z[inner], depth[inner], atol=0.02)
    # the ridge that steadies one-sided fits takes a few percent of the slope
    np.testing.assert_allclose(p[inner], 0.1, rtol=0.08)
    np.testing.assert_allclose(q[inner], -0.05, rtol=0.08)


def test_a_map_without_depths_or_without_weights_has_no_planes() -> None:
    depth = np.full((5, 6), np.nan, dtype=np.float32)
    assert np.isnan(local_planes(depth, np.ones_like(depth), 2, 1.0)).all()
    flat = np.zeros((5, 6), dtype=np.float32)
    assert np.isnan(local_planes(flat, np.zeros_like(flat), 2, 1.0)).all()
