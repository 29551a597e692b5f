from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.residual_statistics import residual_statistics
from semsfm_colmap.types import OrthographicCameras
from tests.report.series import empty_reconstruction, make_inputs, make_reconstruction


def residuals(reconstruction):
    result = compute_metrics(make_inputs(reconstruction)).residuals
    assert result is not None
    return result


def test_the_noise_put_in_comes_out_per_axis_from_both_sides():
    rec = make_reconstruction(np.arange(20) * 4.0, num_points=3000, sigma_px=(0.3, 0.5))
    r = residuals(rec)
    bound = 5.0 / np.sqrt(2.0 * r.num_residuals)
    for axis, sigma in ((r.x, 0.3), (r.y, 0.5)):
        assert abs(axis.sigma_px / sigma - 1.0) < bound
        assert abs(axis.mean_px) < 5.0 * sigma / np.sqrt(r.num_residuals)
        # the median absolute deviation has 37 % efficiency
        assert abs(axis.robust_sigma_px / sigma - 1.0) < bound / np.sqrt(0.37)
    rms = np.sqrt((0.3**2 + 0.5**2) / 2.0)
    assert r.rms_per_coordinate_px == pytest.approx(rms, rel=bound)


def fitted_points(rec):
    """The points that fit the measurements best: linear least squares, point by point."""
    obs, P = rec.observations, rec.cameras.projection
    points = np.empty_like(rec.points)
    for j in range(len(points)):
        rows = np.flatnonzero(obs.track_idx == j)
        A = P[obs.image_idx[rows]].reshape(-1, 3)
        b = (obs.xy[rows] - rec.cameras.translation_px[obs.image_idx[rows]]).reshape(-1)
        points[j] = np.linalg.lstsq(A, b, rcond=None)[0]
    return replace(rec, points=points)


def test_the_noise_estimate_undoes_what_fitting_the_points_takes_up():
    rec = fitted_points(
        make_reconstruction(np.arange(12) * 6.0, num_points=1500, sigma_px=(0.4, 0.4), window=2)
    )
    r = residuals(rec)
    assert r.x.sigma_px < 0.35
    assert r.noise_sigma_px == pytest.approx(0.4, rel=0.03)


def test_nanometres_are_pixels_times_the_pixel_size():
    rec = make_reconstruction(np.arange(5) * 4.0)
    r = residuals(rec)
    assert r.x.sigma_nm == pytest.approx(50.0 * r.x.sigma_px)
    assert r.noise_sigma_nm == pytest.approx(50.0 * r.noise_sigma_px)


def test_a_stretched_y_axis_has_smaller_pixels_there():
    rec = make_reconstruction(np.arange(5) * 4.0)
    cameras = rec.cameras
    stretched = OrthographicCameras(
        cam_from_world=cameras.cam_from_world,
        scale_px_per_unit=cameras.scale_px_per_unit,
        translation_px=cameras.translation_px,
        aspect=1.25,
    )
    r = residuals(replace(rec, cameras=stretched))
    assert r.y.sigma_nm == pytest.approx(40.0 * r.y.sigma_px)


def test_without_a_pixel_size_there_are_no_nanometres():
    rec = make_reconstruction(
        np.arange(5) * 4.0, world_unit="px", pixel_size_um=None, pixel_size_source="none"
    )
    r = residuals(rec)
    assert r.x.sigma_nm is None
    assert r.noise_sigma_nm is None


def test_without_an_observation_there_are_no_residuals():
    rec = empty_reconstruction(2)
    assert residual_statistics(rec, rec.residuals(), None) is None
