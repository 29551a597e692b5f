"""Models of noise, and honest models that are weak in one thing only."""

from dataclasses import replace

import numpy as np

from semsfm_colmap.refinement.substance import Substance, substance
from semsfm_colmap.types import Observations

NEEDLE = Substance(
    observations_per_image=21.0,
    rotation_deg=22.0,
    rotation_sigma_deg=4.0,
    depth_sigmas=0.7,
    num_images=42,
    num_given=77,
)


def test_a_model_that_is_thin_in_everything_is_noise():
    assert NEEDLE.is_noise
    assert "22.0 +- 4.0 deg" in NEEDLE.message
    assert "42 of 77 images" in NEEDLE.message


def test_many_tracks_are_no_noise_though_the_tilt_is_small():
    assert not replace(NEEDLE, observations_per_image=2000.0).is_noise


def test_few_tracks_alone_are_no_noise():
    sure = Substance(
        observations_per_image=20.0,
        rotation_deg=60.0,
        rotation_sigma_deg=0.3,
        depth_sigmas=50.0,
        num_images=9,
        num_given=10,
    )
    assert not sure.is_noise
    assert replace(sure, num_images=3).is_noise
    assert replace(sure, rotation_sigma_deg=float("inf")).is_noise


def test_depth_is_measured_against_the_error_bars_of_the_points():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200, 3)) * [100.0, 80.0, 6.0]
    N, M = len(points), 4
    obs = Observations(
        image_idx=np.tile(np.arange(M), N),
        track_idx=np.repeat(np.arange(N), M),
        keypoint_idx=np.arange(M * N),
        xy=np.zeros((M * N, 2)),
        num_images=M,
        num_tracks=N,
    )
    covariance = np.tile(np.diag([0.1, 0.1, 4.0]), (N, 1, 1))
    found = substance(
        points, covariance, obs, rotation_deg=40.0, rotation_sigma_deg=1.0, num_given=4
    )
    assert abs(found.depth_sigmas - 3.0) < 0.4
    assert found.observations_per_image == N
