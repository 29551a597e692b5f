"""The ray caster, against a ball."""

import numpy as np

from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene, ray_tensor
from semsfm_colmap.synthetic.primitives import geodesic_sphere
from tests.oracles.rays import is_hidden


def test_parallel_rays_meet_a_ball_where_its_formula_says():
    scene = ray_scene(*geodesic_sphere(40))
    x = np.linspace(-0.9, 1.5, 13)
    start = np.stack([x, np.zeros(13), np.full(13, -3.0)], axis=1)
    depth = scene.cast_rays(ray_tensor(start, np.array([0.0, 0.0, 1.0])))["t_hit"].numpy()
    hits = np.abs(x) < 1.0
    np.testing.assert_allclose(depth[hits], 3.0 - np.sqrt(1.0 - x[hits] ** 2), atol=5e-3)
    assert np.all(np.isinf(depth[~hits]))


def test_rays_of_one_direction_and_of_a_direction_each_are_the_same():
    origin = np.random.default_rng(0).normal(size=(4, 5, 3))
    one = ray_tensor(origin, np.array([0.0, 1.0, 0.0])).numpy()
    each = ray_tensor(origin, np.tile([0.0, 1.0, 0.0], (4, 5, 1))).numpy()
    assert one.shape == (4, 5, 6)
    assert one.dtype == np.float32
    np.testing.assert_array_equal(one, each)


def test_what_is_hidden_is_what_a_ray_against_every_triangle_says():
    vertices, faces = geodesic_sphere(4)
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.5, 1.5, (60, 3))
    to_viewer = rng.normal(size=3)
    to_viewer /= np.linalg.norm(to_viewer)
    hidden = ray_scene(vertices, faces).test_occlusions(ray_tensor(points, to_viewer)).numpy()
    assert 0 < hidden.sum() < 60
    np.testing.assert_array_equal(
        hidden, [is_hidden(point, to_viewer, vertices, faces, 0.0) for point in points]
    )


def test_the_closest_point_of_a_ball_is_on_the_way_to_its_centre():
    scene = ray_scene(*geodesic_sphere(40))
    closest = scene.compute_closest_points(as_tensor(np.array([[0, 3, 0]], dtype=np.float32)))
    np.testing.assert_allclose(closest["points"].numpy(), [[0.0, 1.0, 0.0]], atol=5e-3)
