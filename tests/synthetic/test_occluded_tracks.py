import numpy as np
import pytest

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.light_shapes import SHAPES, build_shape
from semsfm_colmap.synthetic.occluded_tracks import (
    RAY_LIFT,
    OccludedTracksOptions,
    _sample,
    _turn,
    _visible,
    noise_scene,
    simulate_occluded,
)
from tests.oracles.rays import is_hidden


def simulate(seed=0, **options):
    defaults = {"num_points": 1500, "num_images": 12, "range_deg": 60.0}
    made = OccludedTracksOptions(**{**defaults, **options})
    return simulate_occluded(made, np.random.default_rng(seed))


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.sum(a * np.cross(b, c)) / 6.0


@pytest.mark.parametrize("shape", ["bumpy", "spiny", "clump", "cup"])
def test_bodies_are_closed_outward_and_smaller_than_the_image(shape):
    for seed in range(3):
        vertices, faces = build_shape(shape, 2.0, np.random.default_rng(seed))
        assert volume(vertices, faces) > 0.1
        assert volume(vertices + 5.0, faces) == pytest.approx(volume(vertices, faces))  # closed
        assert np.abs(vertices).max() < 1.9


@pytest.mark.parametrize("shape", ["field", "crater", "substrate"])
def test_fields_face_the_viewer_and_reach_beyond_the_image(shape):
    vertices, faces = build_shape(shape, 1.6, np.random.default_rng(1))
    assert np.ptp(vertices[:, :2], axis=0) == pytest.approx([3.2, 3.2], abs=0.05)
    sheet = np.unique(faces)[: (len(vertices) if shape != "substrate" else 100)]
    assert np.mean(vertex_normals(vertices, faces)[sheet, 2]) < -0.5


def test_a_cup_opens_toward_the_viewer():
    vertices, faces = build_shape("cup", 2.0, np.random.default_rng(4))
    seen = vertex_normals(vertices, faces)[:, 2] < -0.3
    middle = np.linalg.norm(vertices[:, :2], axis=1) < 0.3
    rim = np.linalg.norm(vertices[:, :2], axis=1) > 0.85
    assert vertices[seen & middle, 2].mean() > vertices[rim, 2].mean() + 0.1


@pytest.mark.parametrize("shape", ["clump", "substrate"])
def test_what_is_visible_agrees_with_every_ray_against_every_triangle(shape):
    rng = np.random.default_rng(3)
    vertices, faces = build_shape(shape, 1.3, rng)
    points, normals, _ = _sample((vertices, faces), 60, rng)
    cameras, _, _ = _turn(OccludedTracksOptions(num_images=3, range_deg=70.0), rng)
    visible = _visible((vertices, faces), points, normals, cameras)
    facing = normals @ cameras.viewing_direction.T < 0
    assert np.sum(facing.T & ~visible) > 5  # hidden by something in between
    assert np.sum(visible) > 20
    for i, d in enumerate(cameras.viewing_direction):
        for j, point in enumerate(points):
            hidden = normals[j] @ d >= 0 or is_hidden(point, -d, vertices, faces, RAY_LIFT)
            assert visible[i, j] == (not hidden)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_same_seed_gives_the_same_scene_and_another_one_another(shape):
    a, b, c = simulate(shape=shape), simulate(shape=shape), simulate(seed=1, shape=shape)
    assert np.array_equal(a.points, b.points)
    assert np.array_equal(a.observations.xy, b.observations.xy)
    assert len(a.observations) != len(c.observations)
    assert len(a.points) > 100


def test_observations_are_sorted_unique_and_long_enough():
    scene = simulate(shape="clump", wrong_share=0.05)
    for obs in (scene.raw, scene.observations):
        key = obs.track_idx * obs.num_images + obs.image_idx
        assert np.all(np.diff(key) > 0)
        assert np.bincount(obs.track_idx, minlength=obs.num_tracks).min() >= 3
    assert scene.observations.num_tracks == len(scene.points)


def test_keypoints_have_the_noise_asked_for_from_both_sides():
    scene = simulate(
        num_points=3000, noise_px=0.4, shading_px=0.0, wrong_share=0.0, rotation_error_deg=0.0,
        tilt_error=0.0, track_length_deg=1e6,
    )  # fmt: skip
    obs = scene.observations
    r = scene.cameras.project(scene.points[obs.track_idx], obs.image_idx) - obs.xy
    free = 2 * len(obs) - 3 * len(scene.points)
    assert 0.36 < np.sqrt(np.sum(r**2) / free) < 0.42


def test_tracks_break_at_the_rate_asked_for():
    def mean_turn(length):
        obs = simulate(
            shape="field", range_deg=60.0, num_images=121, detection=0.98, wrong_share=0.0,
            track_length_deg=length, num_points=600,
        ).raw  # fmt: skip
        first = np.full(obs.num_tracks, 999)
        np.minimum.at(first, obs.track_idx, obs.image_idx)
        last = np.zeros(obs.num_tracks, dtype=int)
        np.maximum.at(last, obs.track_idx, obs.image_idx)
        return 0.5 * np.mean(last - first)

    assert 2.0 < mean_turn(4.0) < 6.0
    assert mean_turn(12.0) > 1.6 * mean_turn(4.0)


def test_nothing_is_detected_on_the_far_side_or_beyond_the_limit():
    scene = simulate(shape="bumpy", wrong_share=0.0, limit_deg=60.0, range_deg=180.0)
    obs = scene.observations
    depth = np.einsum(
        "oj,oj->o", scene.cameras.viewing_direction[obs.image_idx], scene.points[obs.track_idx]
    )
    assert np.mean(depth < 0.0) > 0.98


def test_a_preference_for_ridges_moves_the_points_up():
    def height(preference):
        scene = simulate(shape="field", ridge_preference=preference, num_points=3000, seed=5)
        return -np.median(scene.points[:, 2])

    assert height(1.5) > height(-1.5) + 0.01


def test_wrong_observations_are_there_in_the_share_asked_for():
    clean, dirty = simulate(wrong_share=0.0), simulate(wrong_share=0.2)
    assert 1.05 * len(clean.raw) < len(dirty.raw) < 1.25 * len(clean.raw)


def test_a_model_of_noise_has_points_that_fit_their_observations():
    scene = noise_scene(12, 400, np.random.default_rng(0))
    obs = scene.observations
    r = scene.cameras.project(scene.points[obs.track_idx], obs.image_idx) - obs.xy
    assert len(scene.points) > 200
    assert np.linalg.norm(r, axis=1).max() < 5.0
