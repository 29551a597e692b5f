"""OpenCV's SIFT as features of ours."""

import cv2
import numpy as np
import pytest

from semsfm_colmap.colmap.sift_features import sift_features
from semsfm_colmap.features import opencv_sift as module
from semsfm_colmap.features.opencv_sift import describe_sift, detect_sift, opencv_sift
from semsfm_colmap.matching.nearest import match_nearest
from tests.features.images import disk, textured, warp_image


def grey(image):
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("first_octave", [-1, 0])
def test_a_disk_is_found_in_its_place_at_its_scale(first_octave):
    image = grey(disk((200, 240), (110.3, 95.7), 12.0))
    found = opencv_sift(image, upright=True, first_octave=first_octave)
    best = np.argmax(found.response)
    assert np.allclose(found.xy[best], (110.3, 95.7), atol=0.06)
    # the Laplacian is extremal at the radius over root 2, the geometric mean of the scales whose
    # difference is taken: the smaller of them, which names the keypoint, is 2^(1/6) below
    expected = 12.0 / np.sqrt(2.0) / 2.0 ** (1.0 / 6.0)
    assert found.scale_px[best] == pytest.approx(expected, rel=0.03)


def test_descriptors_are_of_length_one_and_survive_a_turn_and_a_gain():
    image = textured()
    turn = np.deg2rad(30.0)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    centre = np.array([160.0, 120.0])
    shift = centre - R @ centre
    a = opencv_sift(grey(image))
    b = opencv_sift(grey(0.8 * warp_image(image, R, shift, image.shape) + 10.0))
    assert np.allclose(np.linalg.norm(a.descriptors, axis=1), 1.0, atol=1e-5)
    i, j = match_nearest(a.descriptors, b.descriptors, max_ratio=0.8).keypoints.T
    off = np.linalg.norm(a.xy[i] @ R.T + shift - b.xy[j], axis=1)
    assert len(i) > 150
    assert np.mean(off < 1.0) > 0.95
    turned = np.angle(np.exp(1j * (b.angle_rad[j] - a.angle_rad[i] - turn)))[off < 1.0]
    assert np.median(np.abs(turned)) < np.deg2rad(3.0)


def test_what_was_detected_once_is_described_both_ways():
    detected = detect_sift(grey(textured()))
    for upright in (True, False, True):
        found = describe_sift(detected, upright=upright)
        alone = opencv_sift(grey(textured()), upright=upright)
        np.testing.assert_array_equal(found.xy, alone.xy)
        np.testing.assert_array_equal(found.angle_rad, alone.angle_rad)
        np.testing.assert_array_equal(found.descriptors, alone.descriptors)


def test_upright_keypoints_are_one_a_place_and_not_turned():
    turned, upright = opencv_sift(grey(textured())), opencv_sift(grey(textured()), upright=True)
    rows = np.column_stack([upright.xy, upright.scale_px])
    assert len(np.unique(rows, axis=0)) == len(rows) < len(turned.xy)
    assert np.all(upright.angle_rad == 0.0)
    assert np.allclose(upright.affine_shape, upright.scale_px[:, None, None] * np.eye(2))


def test_nothing_is_found_where_the_mask_forbids_and_no_more_than_wanted_elsewhere():
    mask = np.ones((240, 320), dtype=bool)
    mask[:, :160] = False
    assert np.all(opencv_sift(grey(textured()), mask).xy[:, 0] > 159.0)
    few = opencv_sift(grey(textured()), max_num_features=50)
    assert len(few.xy) == len(few.descriptors) == 50
    quarter = (few.xy[:, 0] > 160).astype(int) + 2 * (few.xy[:, 1] > 120)
    assert np.all(np.bincount(quarter, minlength=4) > 5)


def test_an_image_without_structure_has_no_keypoints():
    found = opencv_sift(np.full((80, 90), 77, dtype=np.uint8))
    assert found.xy.shape == (0, 2)
    assert found.descriptors.shape == (0, 128)


def test_a_large_image_is_not_doubled(monkeypatch):
    image = grey(textured())
    expected = opencv_sift(image, first_octave=0)
    monkeypatch.setattr(module, "MAX_DOUBLED_PX", 300)
    assert np.array_equal(opencv_sift(image).xy, expected.xy)


def test_the_number_of_threads_does_not_matter():
    before = cv2.getNumThreads()
    try:
        found = []
        for number in (1, 2, 4):
            cv2.setNumThreads(number)
            found.append(opencv_sift(grey(textured()), max_num_features=400))
    finally:
        cv2.setNumThreads(before)
    for other in found[1:]:
        assert np.array_equal(other.xy, found[0].xy)
        assert np.array_equal(other.descriptors, found[0].descriptors)


def test_keypoints_and_descriptors_are_those_of_colmap(tmp_path):
    image = grey(textured())
    cv2.imwrite(str(tmp_path / "a.png"), image)
    theirs = sift_features("colmap-sift", tmp_path, ["a.png"], [(320, 240)], upright=True)[0]
    ours = opencv_sift(image, upright=True)
    matches = match_nearest(ours.descriptors, theirs.descriptors / 512.0, max_ratio=0.8)
    i, j = matches.keypoints.T
    off = np.linalg.norm(ours.xy[i] - theirs.xy[j], axis=1)
    assert len(i) > 0.7 * len(theirs.xy)
    assert np.median(off) < 0.05
    assert np.max(np.abs(np.median(ours.xy[i] - theirs.xy[j], axis=0))) < 0.02
    assert np.median(matches.distance) < 0.2
