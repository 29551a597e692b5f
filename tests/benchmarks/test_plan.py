import numpy as np

from benchmarks.plan import errors, measured, noisy, predicted, set_up
from semsfm_colmap.geometry.rotations import depth_reversed, rotation_from_vector
from semsfm_colmap.planning.options import NoiseOptions
from semsfm_colmap.planning.series import planned_geometry

SETUP = set_up("field", 7, 40.0, 0.3)


def small():
    geometry = planned_geometry(SETUP.size, SETUP.specimen, SETUP.noise, num_sampled=80, seed=3)
    assert geometry is not None
    return geometry


def test_full_runs_err_as_predicted():
    geometry = small()
    said, found = predicted(SETUP, geometry), measured(SETUP, geometry, 12)
    # the median over 80 points of RMS errors over 12 runs scatters by a few percent
    assert 0.85 < found.depth_px / said.depth_px < 1.15
    assert 0.7 < found.rotation_deg / said.rotation_deg < 1.4


def test_without_noise_the_tracks_are_the_geometry():
    geometry = small()
    quiet = NoiseOptions(noise_px=1e-12, scale_sigma=1e-12, drift_sigma_px=0.0)
    obs = noisy(geometry, quiet, np.random.default_rng(0))
    np.testing.assert_allclose(obs.xy, geometry.observations.xy, atol=1e-9)


def test_the_truth_in_another_world_and_of_the_other_hand_has_no_errors():
    geometry = small()
    Q = rotation_from_vector(np.array([0.3, 0.2, -0.5]))
    R = np.asarray(geometry.cameras.cam_from_world) @ Q.T
    X = geometry.points @ Q.T + [10.0, 20.0, 30.0]
    everything = np.arange(len(R)), np.arange(len(X))
    for mirrored in (False, True):
        if mirrored:
            R, X = depth_reversed(R), X * [1.0, 1.0, -1.0]
        run = errors(geometry, *everything, R, X)
        assert np.abs(run.depth_px).max() < 1e-9
        assert np.abs(run.rotation_rad).max() < 1e-9
