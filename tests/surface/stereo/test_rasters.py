"""Images and masks as the stereo reads them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.stereo.rasters import (
    raster_reader,
    read_raster,
    scaled_size,
)


def write(path: Path, image: np.ndarray) -> None:
    assert cv2.imwrite(str(path), image)


def test_images_are_reduced_to_the_longer_side_and_never_enlarged() -> None:
    assert scaled_size(1000, 400, 500) == (500, 200)
    assert scaled_size(400, 1000, 500) == (200, 500)
    assert scaled_size(300, 200, 500) == (300, 200)


def test_a_mask_is_reduced_with_its_image(tmp_path: Path) -> None:
    image = np.full((40, 60), 100, dtype=np.uint8)
    mask = np.full((40, 60), 255, dtype=np.uint8)
    mask[:, :30] = 0
    write(tmp_path / "a.png", image)
    write(tmp_path / "a.png.png", mask)
    raster = read_raster(tmp_path, tmp_path, "a.png", 30, (60, 40))
    assert raster.grey.shape == (20, 30)
    np.testing.assert_allclose(raster.grey, 100.0)
    assert not raster.usable[:, :15].any()
    assert raster.usable[:, 15:].all()
    assert read_raster(tmp_path, tmp_path / "none", "a.png", 30, (60, 40)).usable.all()


def test_an_image_is_read_once_while_it_is_kept(tmp_path: Path) -> None:
    write(tmp_path / "a.png", np.zeros((10, 10), np.uint8))
    read = raster_reader(tmp_path, None, ("a.png",), np.array([[10, 10]]), 10, 2)
    assert read(0) is read(0)


def test_a_missing_a_broken_and_another_image_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.png cannot be read"):
        read_raster(tmp_path, None, "a.png", 100, (10, 10))
    (tmp_path / "a.png").write_bytes(b"not a picture")
    with pytest.raises(InputError, match=r"a\.png cannot be read"):
        read_raster(tmp_path, None, "a.png", 100, (10, 10))
    write(tmp_path / "a.png", np.zeros((10, 12), np.uint8))
    with pytest.raises(InputError, match=r"12 x 10 px .* 10 x 10 px"):
        read_raster(tmp_path, None, "a.png", 100, (10, 10))


def test_a_mask_of_another_size_is_named(tmp_path: Path) -> None:
    write(tmp_path / "a.png", np.zeros((10, 10), np.uint8))
    write(tmp_path / "a.png.png", np.zeros((5, 5), np.uint8))
    with pytest.raises(InputError, match=r"a\.png\.png is not a mask"):
        read_raster(tmp_path, tmp_path, "a.png", 10, (10, 10))
