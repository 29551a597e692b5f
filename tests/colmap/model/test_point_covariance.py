"""Error bars of sparse points against the scatter of points that are triangulated again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.any_model import read_any_model
from semsfm_colmap.colmap.model.point_covariance import point_covariances
from tests.colmap.perspective_models import around, ball, perspective_model, write_model

NOISE_PX = 0.4


def noisy_model(seed, folder, *, num=150, num_views=7, camera_model="PINHOLE"):
    """The points of a ball where noisy keypoints put them, cameras exact."""
    true = perspective_model(ball(num), around(num_views), camera_model=camera_model)
    rng = np.random.default_rng(seed)
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(true.cameras[1])
    noisy, poses = {}, {}
    for i, image in true.images.items():
        xy = np.array([p.xy for p in image.points2D])
        noisy[i] = xy + rng.normal(0.0, NOISE_PX, xy.shape)
        poses[i] = image.cam_from_world()
        copy = pycolmap.Image(name=image.name, keypoints=noisy[i], camera_id=1, image_id=i)
        model.add_image_with_trivial_frame(copy, poses[i])
    for point in (true.points3D[k] for k in sorted(true.points3D)):

        def off(x, point=point):
            rows = [
                true.cameras[1].img_from_cam(poses[e.image_id] * x)
                - noisy[e.image_id][e.point2D_idx]
                for e in point.track.elements
            ]
            return np.concatenate(rows)

        model.add_point3D(least_squares(off, point.xyz).x, point.track, point.color)
    write_model(model, folder)
    truth = np.array([true.points3D[k].xyz for k in sorted(true.points3D)])
    return read_any_model(folder), truth


@pytest.mark.parametrize("camera_model", ["PINHOLE", "OPENCV"])
def test_error_bars_are_as_large_as_the_errors(camera_model, tmp_path):
    ratio = []
    for seed in range(3):
        model, truth = noisy_model(seed, tmp_path / str(seed), camera_model=camera_model)
        C = point_covariances(model)
        error = model.points - truth
        ratio.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(C), error) / 3.0)
    # the mean of 450 chi-squared values of 3 degrees of freedom, over 3: 1 +- 0.04
    assert 0.88 < np.mean(np.concatenate(ratio)) < 1.12


def test_a_point_of_nearly_parallel_rays_is_uncertain_along_them(tmp_path):
    near, _ = noisy_model(0, tmp_path / "near", num_views=60)
    model = perspective_model(ball(150), around(3, 1.5))
    write_model(model, tmp_path / "narrow")
    narrow = read_any_model(tmp_path / "narrow")
    # without a residual there is no noise
    assert np.abs(point_covariances(narrow)).max() < 1e-9
    size, axis = np.linalg.eigh(point_covariances(near))
    assert np.sqrt(size[:, 2] / size[:, 0]).max() < 30.0
    for image in model.images.values():
        for k, point in enumerate(image.points2D):
            point.xy = point.xy + NOISE_PX * np.array([(-1.0) ** k, (-1.0) ** (k // 2)])
    write_model(model, tmp_path / "narrow")
    size, axis = np.linalg.eigh(point_covariances(read_any_model(tmp_path / "narrow")))
    assert (size[:, 2] > 100.0 * size[:, 1]).all()
    view = narrow.points - narrow.centres.mean(axis=0)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    assert (np.abs(np.einsum("ni,ni->n", axis[:, :, 2], view)) > 0.99).all()


def test_without_a_redundant_observation_nothing_is_known(tmp_path):
    model = perspective_model(ball(30), around(6))
    for image in list(model.images.values()):
        for k, point in enumerate(image.points2D):
            if point.has_point3D() and len(model.points3D[point.point3D_id].track.elements) > 1:
                model.delete_observation(image.image_id, k)
    folder = write_model(model, tmp_path / "m")
    assert np.isnan(point_covariances(read_any_model(folder))).all()
