from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.prediction import Geometry, own_covariance, predict, rigid_motions
from semsfm_colmap.planning.series import SeriesSize, planned_geometry
from semsfm_colmap.refinement.bundle import plain_model
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.synthetic.tracks import simulate_tracks

NOISE = NoiseOptions(noise_px=0.3)


def small(num_frames=7, total_deg=40.0, specimen="field", num_sampled=150) -> Geometry:
    geometry = planned_geometry(
        SeriesSize(num_frames=num_frames, total_deg=total_deg),
        SpecimenOptions(specimen=specimen, num_points=num_sampled),
        NOISE,
        num_sampled=num_sampled,
    )
    assert geometry is not None
    return geometry


def whole_information(geometry: Geometry, noise: NoiseOptions):
    """Normal matrix of all parameters, cameras and points, nothing eliminated."""
    obs, M, N = geometry.observations, len(geometry.cameras), len(geometry.points)
    base = plain_model(M, noise.scale_sigma)
    height = np.full(M, geometry.height_px)
    model = ScanDriftModel.build(base, noise.drift_sigma_px, height)
    params = (geometry.cameras, np.zeros((M, 2)))
    J = model.jacobian(params, geometry.points, obs.image_idx, obs.track_idx)
    n = model.num_params
    whole = np.zeros((2 * len(obs), n + 3 * N))
    for o in range(len(obs)):
        i, j = obs.image_idx[o], obs.track_idx[o]
        whole[2 * o : 2 * o + 2, model.param_idx[i]] = J[o]
        whole[2 * o : 2 * o + 2, n + 3 * j : n + 3 * j + 3] = geometry.cameras.projection[i]
    H = whole.T @ whole / noise.noise_px**2
    _, prior = model.prior(params)
    H[:n, :n] += (prior.T @ prior).toarray()
    return H, n


@pytest.mark.parametrize("specimen", ["field", "body"])
def test_depths_have_the_covariance_of_the_whole_system_after_a_rigid_motion(specimen):
    geometry = small(specimen=specimen, total_deg=60.0)
    H, n = whole_information(geometry, NOISE)
    scale = 1.0 / np.sqrt(np.diag(H))
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    assert values[5] < 1e-9 * values[6]  # rotations and shifts of the world, nothing else
    root = scale[:, None] * (vectors[:, 6:] / np.sqrt(values[6:]))
    points = root[n:]
    G = rigid_motions(geometry.points)
    points = points - G @ np.linalg.pinv(G) @ points
    along = np.einsum("nk,nkc->nc", geometry.normals, points.reshape(-1, 3, points.shape[1]))
    expected = np.linalg.norm(along, axis=1)
    found = predict(geometry, NOISE)
    assert found is not None
    # the module leaves six of 3 N degrees of freedom in
    assert np.median(found.depth_px / expected) == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(found.depth_px, expected, rtol=0.15)


def test_a_point_seen_by_known_cameras_has_the_depth_sigma_of_the_closed_form():
    geometry = small()
    angles = np.deg2rad(np.linspace(-20.0, 20.0, 7))
    R = rotation_from_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))
    cameras = replace(geometry.cameras, cam_from_world=R)
    covariance = own_covariance(cameras, geometry.observations, 0.3)
    expected = 0.3 / np.sqrt(np.sum(np.sin(angles) ** 2))
    np.testing.assert_allclose(np.sqrt(covariance[:, 2, 2]), expected, rtol=1e-12)


def test_a_turned_and_shifted_world_has_the_same_error_bars():
    geometry = small(specimen="body", total_deg=60.0)
    Q = rotation_from_vector(np.array([0.4, -0.9, 0.3]))
    shift = np.array([300.0, -200.0, 900.0])
    R = np.asarray(geometry.cameras.cam_from_world) @ Q.T
    points = geometry.points @ Q.T + shift
    t = geometry.cameras.translation_px - (R @ shift)[:, :2]
    turned = replace(
        geometry,
        points=points,
        normals=geometry.normals @ Q.T,
        cameras=replace(geometry.cameras, cam_from_world=R, translation_px=t),
    )
    before, after = predict(geometry, NOISE), predict(turned, NOISE)
    assert before is not None
    assert after is not None
    for name in ("own_px", "cameras_px", "shading_px", "sigma_rotation_rad"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=1e-5)


def test_points_that_stand_for_a_hundred_fix_the_cameras_like_noise_ten_times_smaller():
    geometry = small()
    alone = predict(geometry, NOISE)
    many = predict(replace(geometry, points_per_point=100.0), NOISE)
    quiet = predict(geometry, replace(NOISE, noise_px=0.1 * NOISE.noise_px))
    assert alone is not None
    assert many is not None
    assert quiet is not None
    np.testing.assert_allclose(many.own_px, alone.own_px, rtol=1e-12)
    np.testing.assert_allclose(many.cameras_px, quiet.cameras_px, rtol=1e-9)
    np.testing.assert_allclose(many.sigma_rotation_rad, quiet.sigma_rotation_rad, rtol=1e-9)


def test_what_shading_does_is_not_lowered_by_more_points():
    geometry = small(specimen="body", total_deg=60.0)
    alone = predict(geometry, NOISE)
    many = predict(replace(geometry, points_per_point=1e4), NOISE)
    assert alone is not None
    assert many is not None
    assert np.median(many.shading_px) > 0.5 * np.median(alone.shading_px) > 0.0


def test_two_images_leave_the_depth_undetermined():
    simulated = simulate_tracks(
        num_images=2,
        range_deg=20.0,
        num_tracks=50,
        noise_px=0.0,
        body="field",
        rng=np.random.default_rng(0),
    )
    geometry = Geometry(
        cameras=simulated.cameras,
        points=simulated.points,
        normals=np.tile([0.0, 0.0, -1.0], (len(simulated.points), 1)),
        observations=simulated.observations,
        height_px=1000.0,
    )
    found = predict(geometry, replace(NOISE, drift_sigma_px=0.0))
    # the bas-relief family: only the prior of the magnification holds the angle, hardly
    assert found is None or found.median_px > 20.0
