import numpy as np

from semsfm_colmap.colmap.sift_features import (
    descriptor_bytes,
    features_of_rows,
    rows_of_features,
)


def test_descriptors_are_stored_as_colmap_scales_them():
    assert descriptor_bytes(np.array([[0.0, 0.1, 0.6]])).tolist() == [[0, 51, 255]]


def test_features_are_read_back_from_keypoint_rows():
    angle, scale = 0.3, 4.0
    frame = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    rows = np.array([[10.0, 20.0, *frame.ravel()]])
    features = features_of_rows(rows)
    np.testing.assert_allclose(features.scale_px, [scale])
    np.testing.assert_allclose(features.angle_rad, [angle])
    np.testing.assert_allclose(features.xy, [[10.0, 20.0]])
    np.testing.assert_array_equal(rows_of_features(features), rows)
