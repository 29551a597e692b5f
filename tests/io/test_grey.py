"""Prepared images are read whatever their names; broken ones in one sentence."""

import os

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.io import grey
from semsfm_colmap.io.apart import call_apart
from semsfm_colmap.io.grey import read_grey, read_grey_of_others, read_mask


def test_names_with_spaces_and_unicode_are_read(tmp_path):
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    path = tmp_path / "ä b 花.png"
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    np.testing.assert_array_equal(read_grey(path), pixels)


@pytest.mark.parametrize("content", [b"", b"not an image"])
def test_what_is_no_image_is_said(tmp_path, content):
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png cannot be read"):
        read_grey(path)


def test_a_mask_is_true_where_it_is_not_zero_and_none_where_there_is_none(tmp_path):
    mask = np.array([[0, 255], [1, 0]], dtype=np.uint8)
    (tmp_path / "a.tif.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    np.testing.assert_array_equal(read_mask(tmp_path, "a.tif"), mask > 0)
    assert read_mask(tmp_path, "b.tif") is None
    assert read_mask(None, "a.tif") is None


def test_an_image_of_others_that_ends_its_decoder_is_named(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(cv2.imencode(".png", np.eye(9, dtype=np.uint8))[1].tobytes())
    np.testing.assert_array_equal(read_grey_of_others(path), np.eye(9))
    monkeypatch.setattr(grey, "call_apart", lambda allowance, *_: call_apart(allowance, os.abort))
    with pytest.raises(InputError, match=r"a\.png ended the process that decoded it .SIGABRT"):
        read_grey_of_others(path)
