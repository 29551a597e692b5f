"""Models of any program as plain arrays."""

from __future__ import annotations

import os

import cv2
import numpy as np
import pytest

from semsfm_colmap.colmap.model import any_model
from semsfm_colmap.colmap.model.any_model import (
    holds_model,
    image_names,
    model_size,
    read_any_model,
)
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.apart import call_apart
from tests.colmap.perspective_models import (
    DISTANCE,
    SIZE,
    around,
    ball,
    perspective_model,
    write_model,
)


@pytest.mark.parametrize("text", [False, True])
def test_points_cameras_and_who_sees_what_are_those_of_the_model(text, tmp_path):
    model = perspective_model(ball(120), around(8))
    read = read_any_model(write_model(model, tmp_path / "m", text=text))
    assert read.image_names == tuple(f"view_{i:02d}.png" for i in range(8))
    np.testing.assert_array_equal(read.image_size_px, np.tile(SIZE, (8, 1)))
    np.testing.assert_allclose(np.linalg.norm(read.centres, axis=1), DISTANCE)
    np.testing.assert_allclose(read.cam_from_world, around(8), atol=1e-9)
    np.testing.assert_allclose(read.matrix[3], [[300, 0, 160], [0, 300, 120], [0, 0, 1]])
    lengths = [p.track.length() for _, p in sorted(model.points3D.items())]
    np.testing.assert_array_equal(read.track_length(), lengths)
    assert model_size(tmp_path / "m") == (8, len(lengths))
    assert image_names(tmp_path / "m") == set(read.image_names)
    facing = read.points[read.observation_point] - read.centres[read.observation_image]
    assert (np.einsum("ni,ni->n", facing, read.points[read.observation_point]) < 0).all()


def test_a_camera_with_distortion_has_no_matrix(tmp_path):
    model = perspective_model(ball(50), around(6), camera_model="OPENCV")
    read = read_any_model(write_model(model, tmp_path / "m"))
    assert np.isnan(read.matrix).all()
    assert set(read.camera_models) == {"OPENCV"}


def test_points_without_colours_take_them_from_the_images(tmp_path):
    black = np.zeros((100, 3), np.uint8)
    model = perspective_model(ball(100), around(6), colors=black)
    folder = write_model(model, tmp_path / "m")
    (tmp_path / "images").mkdir()
    for i in range(6):
        grey = np.full((SIZE[1], SIZE[0], 3), 140, np.uint8)
        assert cv2.imwrite(str(tmp_path / "images" / f"view_{i:02d}.png"), grey)
    assert (read_any_model(folder).colors == 0).all()
    assert (read_any_model(folder, tmp_path / "images").colors == 140).all()


def test_a_folder_without_a_model_holds_none(tmp_path):
    assert not holds_model(tmp_path)
    with pytest.raises(InputError, match="holds no COLMAP model"):
        read_any_model(tmp_path)


def test_an_image_that_ends_the_reader_of_colours_is_one_sentence(tmp_path, monkeypatch):
    black = np.zeros((100, 3), np.uint8)
    folder = write_model(perspective_model(ball(100), around(6), colors=black), tmp_path / "m")
    monkeypatch.setattr(
        any_model, "call_apart", lambda allowance, *_: call_apart(allowance, os.abort)
    )
    with pytest.raises(InputError, match=r"an image below .* ended the process .*SIGABRT"):
        read_any_model(folder, tmp_path)
