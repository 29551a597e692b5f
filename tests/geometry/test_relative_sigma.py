"""Observations with a noise of their own count for what they are worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector, vector_from_rotation
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.covariance import estimate_covariance
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Observations, OrthographicCameras


def test_precision_is_one_without_a_sigma_and_its_inverse_square_with() -> None:
    obs = Observations(
        image_idx=np.array([0, 1]),
        track_idx=np.array([0, 0]),
        keypoint_idx=np.array([0, 0]),
        xy=np.zeros((2, 2)),
        num_images=2,
        num_tracks=1,
    )
    np.testing.assert_array_equal(obs.precision, [1.0, 1.0])
    obs = replace(obs, relative_sigma=np.array([1.0, 2.0]))
    np.testing.assert_array_equal(obs.precision, [1.0, 0.25])
    np.testing.assert_array_equal(obs.select(np.array([False, True])).precision, [0.25])


@pytest.mark.parametrize("factor", [3.0, 6.0])
def test_weights_bring_the_error_of_rotations_to_what_the_covariance_says(factor: float) -> None:
    """Half of the observations are `factor` times noisier."""
    weighted_errors, plain_errors, claimed = [], [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        truth, obs = _series(seed)
        relative = np.where(rng.random(len(obs)) < 0.5, factor, 1.0)
        noise = rng.normal(size=obs.xy.shape) * 0.3 * relative[:, None]
        noisy = replace(obs, xy=obs.xy + noise)
        for observations, errors in (
            (replace(noisy, relative_sigma=relative), weighted_errors),
            (noisy, plain_errors),
        ):
            result = bundle_adjust(truth, observations)
            assert result.value is not None
            errors.append(_relative_error(result.value.cameras, truth))
            if errors is weighted_errors:
                covariance = estimate_covariance(
                    result.value.model, result.value.state, observations, 0.3
                ).value
                assert covariance is not None
                claimed.append(np.sqrt(np.mean(covariance.sigma_rotation_rad**2)))
    weighted = np.sqrt(np.mean(np.square(weighted_errors)))
    assert weighted < 0.75 * np.sqrt(np.mean(np.square(plain_errors)))
    assert 0.5 < weighted / np.mean(claimed) < 2.0


def _series(seed: int) -> tuple[OrthographicCameras, Observations]:
    simulated = simulate_tracks(
        num_images=12, range_deg=60.0, num_tracks=150, noise_px=0.0, rng=np.random.default_rng(seed)
    )
    return simulated.cameras, simulated.observations


def _relative_error(estimated: OrthographicCameras, truth: OrthographicCameras) -> float:
    """RMS rotation error in rad over the images, the common world rotation taken out."""
    S = np.swapaxes(truth.cam_from_world, 1, 2) @ estimated.cam_from_world
    mean = vector_from_rotation(S).mean(axis=0)
    w = vector_from_rotation(S @ rotation_from_vector(mean).T)
    return float(np.sqrt(np.mean(w**2)))
