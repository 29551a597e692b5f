from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.camera_frames import (
    find_view,
    frame_centers,
    frame_outlines,
    labelled_frames,
)
from tests.report.series import make_reconstruction

REC = make_reconstruction(np.arange(12) * 15.0)


def test_each_frame_stands_on_the_ray_through_the_centre_of_its_image():
    cameras = replace(REC.cameras, aspect=1.1, skew=0.05)
    centers = frame_centers(replace(REC, cameras=cameras), find_view(REC.points))
    uv = cameras.project(centers, np.arange(12))
    np.testing.assert_allclose(uv, 0.5 * REC.image_size_px, atol=1e-9)


def test_all_frames_stand_before_the_object_at_one_distance():
    view = find_view(REC.points)
    centers = frame_centers(REC, view)
    depth = np.einsum("ij,ij->i", REC.cameras.viewing_direction, centers - view.center)
    np.testing.assert_allclose(depth, depth[0])
    assert depth[0] < -view.radius


def test_the_mark_of_a_frame_is_at_the_top_of_its_image():
    outlines = frame_outlines(REC, find_view(REC.points))
    for i in range(12):
        uv = REC.cameras.project(outlines[i], np.full(8, i))
        assert np.argmin(uv[:, 1]) == 2
        assert uv[2, 0] == pytest.approx(0.5 * REC.image_size_px[i, 0])


def test_labels_are_few_and_round():
    assert labelled_frames(np.arange(1, 4)).tolist() == [0, 1, 2]
    numbers = np.delete(np.arange(1, 303), [5, 6])
    labelled = numbers[labelled_frames(numbers)]
    assert labelled.tolist() == [1, 50, 100, 150, 200, 250, 300]
