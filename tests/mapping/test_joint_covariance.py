from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.mapping.joint_covariance import joint_covariance
from semsfm_colmap.mapping.pose_covariance import as_refined, displacement_of
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.trust import uncertainty_of
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import OrthographicCameras
from tests.metrology.sizes.builders import simulated_model

OPTIONS = RefinementOptions()


@pytest.fixture(scope="module")
def model():
    return simulated_model()


@pytest.fixture(scope="module")
def joint(model):
    return joint_covariance(model, OPTIONS, None)


def seen(model, tracks):
    """Weights and numbers of images of some tracks, as they were observed."""
    obs = model.observations
    weights = np.zeros((len(tracks), model.num_images))
    for k, track in enumerate(tracks):
        weights[k, obs.image_idx[obs.track_idx == track]] = 1.0
    return weights


def test_the_variance_of_a_point_is_that_of_the_bundle_adjustment(model, joint):
    refined = as_refined(model, OPTIONS)
    height = model.image_size_px[:, 1].astype(float)
    found = uncertainty_of(refined, height, displacement_of(model, OPTIONS, None))
    _, tracks = keep_tracks(model.observations, np.asarray(model.inlier), min_length=2)
    A = model.cameras.projection
    for k in (3, 57, 200):
        weights = seen(model, [tracks[k]])
        own = joint.noise_px**2 * np.linalg.inv(np.einsum("m,mxi,mxj->ij", weights[0], A, A))
        for e in np.eye(3):
            d = joint.surface_direction(
                model.points[tracks[k : k + 1]], np.zeros((1, 3)), weights, e[None]
            )
            cameras = joint.uncertainty.noise.cameras.variance(d)
            assert cameras + e @ own @ e == pytest.approx(
                e @ found.noise.points[k] @ e, rel=0.08
            ), "the loss of the bundle adjustment counts a few observations less"


def test_places_follow_the_cameras_as_triangulation_does(model, joint):
    rng = np.random.default_rng(5)
    tracks = np.array([1, 40, 90])
    points, weights = model.points[tracks], seen(model, tracks)
    gradient = rng.normal(size=(3, 3))
    d = joint.surface_direction(points, np.zeros((3, 3)), weights, gradient)
    step = 1e-6 * rng.normal(size=joint.num_params)

    def triangulated(cameras):
        A, t = cameras.projection, cameras.translation_px
        images = model.cameras.projection @ points.T  # where the places are seen, (M, 2, K)
        images = images + model.cameras.translation_px[:, :, None]
        out = []
        for k in range(3):
            H = np.einsum("m,mxi,mxj->ij", weights[k], A, A)
            b = np.einsum("m,mxi,mx->i", weights[k], A, images[:, :, k] - t)
            out.append(np.linalg.solve(H, b))
        return np.array(out)

    def moved(sign):
        return joint.model.poses(joint.model.retract(joint.params, sign * step))

    # drift, behind the poses, is no part of `poses`: hold it
    poses = joint.model.param_idx[:, :6]
    held = np.zeros_like(step)
    held[np.unique(poses[poses >= 0])] = 1.0
    step *= held
    change = (triangulated(moved(1.0)) - triangulated(moved(-1.0))) / 2.0
    assert d @ step == pytest.approx(np.sum(gradient * change), rel=1e-5)


def turned(model, rotation, shift, scale):
    """The same model in another world, ``X' = scale Q X + shift``."""
    cameras = model.cameras
    R = cameras.cam_from_world @ rotation.T
    scale_px = cameras.scale_px_per_unit / scale
    moved = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=scale_px,
        translation_px=cameras.translation_px - scale_px[:, None] * (R @ shift)[:, :2],
    )
    return replace(model, cameras=moved, points=scale * model.points @ rotation.T + shift)


def test_a_distance_is_as_uncertain_in_any_world(model, joint):
    a, b = 10, 150
    weights = seen(model, [a, b])

    def parts(of, covariance):
        apart = of.points[b] - of.points[a]
        u = apart / np.linalg.norm(apart)
        d = covariance.surface_direction(
            of.points[[a, b]], np.zeros((2, 3)), weights, np.stack([-u, u])
        )
        return covariance.parts(d)

    before = parts(model, joint)
    Q = rotation_from_vector(np.array([0.3, 1.1, -0.4]))
    other = turned(model, Q, np.array([30.0, -20.0, 70.0]), 0.02)
    after = parts(other, joint_covariance(other, OPTIONS, None))
    assert before["noise"] > 0.01
    for name, part in before.items():
        assert after[name] == pytest.approx(0.02 * part, rel=1e-3), name


def test_places_that_are_near_share_their_cameras_errors(model, joint):
    near = np.array([[0.0, 0.0, -300.0], [6.0, 0.0, -300.0]])
    weights = np.ones((2, model.num_images))
    normals = np.tile([0.0, 0.0, -1.0], (2, 1))
    x = np.array([1.0, 0.0, 0.0])
    together = joint.surface_direction(near, normals, weights, np.stack([-x, x]))
    alone = [
        joint.surface_direction(near[k : k + 1], normals[:1], weights[:1], x[None]) for k in (0, 1)
    ]
    independent = np.hypot(*(joint.uncertainty.sigma(d) for d in alone))
    assert joint.uncertainty.sigma(together) < 0.5 * independent


def test_a_ray_moves_with_its_own_image_alone(model, joint):
    point = np.array([[40.0, -30.0, -280.0]])
    normals = np.array([[0.0, 0.0, -1.0]])
    across = np.cross(model.cameras.viewing_direction[2], [0.0, 1.0, 0.0])[None]
    d = joint.ray_direction(point, normals, np.array([2]), across)
    idx = joint.model.param_idx
    others = np.unique(np.delete(idx, 2, axis=0)[:, :6])
    assert np.all(d[others] == 0.0)
    assert np.any(d[idx[2]] != 0.0)
    # a shift of the image by e px moves the ray by -A^+ e
    A = model.cameras.projection[2]
    e = np.array([0.3, -0.2])
    step = np.zeros(joint.num_params)
    step[idx[2, 4:6]] = e
    moved = -A.T @ np.linalg.solve(A @ A.T, e)
    assert d @ step == pytest.approx(float(across[0] @ moved), rel=1e-6)


def test_a_place_that_one_image_sees_is_refused(model, joint):
    weights = np.zeros((1, model.num_images))
    weights[0, 3] = 1.0
    with pytest.raises(ValueError, match="two directions"):
        joint.surface_direction(np.zeros((1, 3)), np.zeros((1, 3)), weights, np.ones((1, 3)))


def test_distances_scatter_as_the_noise_part_says():
    """Bundle adjustments of sixty simulated series; what all of them measure has a true length."""
    ends = np.array([[-150.0, 60.0, -200.0], [120.0, -90.0, -150.0]])
    apart = ends[1] - ends[0]
    true = float(np.linalg.norm(apart))
    pulls = []
    for seed in range(60):
        simulated = simulate_tracks(
            num_images=8, range_deg=50.0, num_tracks=300, noise_px=0.3, radius_px=300.0,
            scale_drift=OPTIONS.scale_sigma, rng=np.random.default_rng(seed),
        )  # fmt: skip
        settings = BundleSettings(scale_sigma=OPTIONS.scale_sigma)
        adjusted = bundle_adjust(simulated.cameras, simulated.observations, settings).value
        model = replace(
            simulated_model(num_images=8),
            cameras=adjusted.cameras,
            points=adjusted.points,
            observations=simulated.observations,
            inlier=np.ones(len(simulated.observations), dtype=bool),
        )
        joint = joint_covariance(model, OPTIONS, None)
        A, t = adjusted.cameras.projection, adjusted.cameras.translation_px
        H = np.einsum("mxi,mxj->ij", A, A)
        found = []
        for end in ends:
            seen = simulated.cameras.project(np.tile(end, (8, 1)), np.arange(8))
            found.append(np.linalg.solve(H, np.einsum("mxi,mx->i", A, seen - t)))
        along = found[1] - found[0]
        length = float(np.linalg.norm(along))
        u = along / length
        d = joint.surface_direction(
            np.array(found), np.zeros((2, 3)), np.ones((2, 8)), np.stack([-u, u])
        )
        pulls.append((length - true) / joint.parts(d)["noise"])
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert abs(np.mean(pulls)) < 0.4
