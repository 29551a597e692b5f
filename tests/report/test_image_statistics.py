from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.metrics import compute_metrics
from tests.report.series import make_inputs, make_reconstruction, poses


def test_rows_follow_the_series_whatever_the_order_of_the_reconstruction():
    rec = make_reconstruction(np.arange(6) * 4.0)
    order = np.array([3, 0, 5, 1, 4, 2])
    place = np.argsort(order)
    mixed = replace(
        rec,
        image_names=tuple(rec.image_names[i] for i in order),
        cameras=rec.cameras.select(order),
        observations=replace(
            rec.observations, image_idx=place[rec.observations.image_idx].astype(np.int64)
        ),
    )
    plain_rows = compute_metrics(make_inputs(rec))
    mixed_rows = compute_metrics(make_inputs(mixed, names=rec.image_names))
    for a, b in zip(plain_rows.per_image, mixed_rows.per_image, strict=True):
        assert a.name == b.name
        assert a.pose.num_observations == b.pose.num_observations
        assert a.pose.rms_px == pytest.approx(b.pose.rms_px)
        assert a.pose.angle_deg == pytest.approx(b.pose.angle_deg, abs=1e-9)
    np.testing.assert_array_equal(
        plain_rows.co_visibility.num_shared_tracks, mixed_rows.co_visibility.num_shared_tracks
    )


def test_missing_images_are_named_and_keep_their_numbers():
    rec = make_reconstruction(np.arange(4) * 4.0)
    a, b, c, d = rec.image_names
    m = compute_metrics(make_inputs(rec, names=[a, "lost 1.png", b, c, d, "lost 2.png"]))
    assert [image.frame for image in m.per_image] == [1, 2, 3, 4, 5, 6]
    registered = [image.pose is not None for image in m.per_image]
    assert registered == [True, False, True, True, True, False]


def test_images_that_only_the_reconstruction_knows_come_last():
    rec = make_reconstruction(np.arange(3) * 4.0)
    m = compute_metrics(make_inputs(rec, names=[rec.image_names[2], "lost.png"]))
    assert [image.name for image in m.per_image] == [
        rec.image_names[2],
        "lost.png",
        rec.image_names[0],
        rec.image_names[1],
    ]


def test_the_relative_scale_is_relative_to_the_median():
    rec = make_reconstruction(np.arange(3) * 4.0)
    cameras = replace(rec.cameras, scale_px_per_unit=np.array([19.98, 20.0, 20.01]))
    rows = poses(compute_metrics(make_inputs(replace(rec, cameras=cameras))))
    assert [pose.relative_scale for pose in rows] == pytest.approx([0.999, 1.0, 1.0005])


def test_what_is_not_known_of_an_image_is_none_and_never_nan():
    first, *_ = poses(compute_metrics(make_inputs(make_reconstruction(np.arange(3) * 4.0))))
    assert first.step_deg is None
    assert first.stage_tilt_deg is None
    assert first.sigma_relative_scale is None
    assert first.sigma_rotation_deg is None


def test_the_formal_errors_of_a_pose_are_those_of_its_image():
    sigma = np.deg2rad([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]])
    rec = make_reconstruction(np.arange(3) * 4.0, sigma_rotation_rad=sigma)
    reverse = rec.image_names[::-1]
    rows = poses(compute_metrics(make_inputs(rec, names=reverse)))
    assert rows[0].sigma_rotation_deg == pytest.approx((0.7, 0.8, 0.9))
    assert rows[2].sigma_rotation_deg == pytest.approx((0.1, 0.2, 0.3))
