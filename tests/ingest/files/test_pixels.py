from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.geometry.pixel_noise import noise_level
from semsfm_colmap.ingest.files.bit_depth import to_grey8
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.frame.enhance import changes_pixels, prepare_pixels
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.conftest import save, texture

OPTIONS = IngestOptions()
PERCENTILES = OPTIONS.range_percentiles


def read(path: Path) -> np.ndarray:
    return read_pixels(path, read_header(path, 10**9)).pixels


def test_eight_bits_are_left_alone() -> None:
    image = texture(0)
    out, span = to_grey8(image, PERCENTILES)
    assert out is image
    assert span == (0.0, 255.0)


def test_twelve_bits_in_sixteen_use_the_whole_range() -> None:
    deep = (texture(0).astype(np.uint16) - 1) * 16
    out, (low, high) = to_grey8(deep, (0.0, 100.0))
    assert (low, high) == (deep.min(), deep.max())
    assert (out.min(), out.max()) == (0, 255)
    # monotone and linear to half a level
    expected = (deep - low) / (high - low) * 255
    assert np.abs(out - expected).max() <= 0.5


def test_hot_and_dead_pixels_do_not_take_the_range() -> None:
    deep = texture(0).astype(np.uint16) + 1000
    spoiled = deep.copy()
    spoiled[0, :8], spoiled[1, :8] = 65535, 0
    clean, _ = to_grey8(deep, PERCENTILES)
    out, _ = to_grey8(spoiled, PERCENTILES)
    assert np.abs(out[5:].astype(int) - clean[5:]).max() <= 25
    assert out.std() > 0.8 * clean.std()


def test_an_image_with_two_values_keeps_both() -> None:
    deep = np.zeros((160, 200), np.uint16)
    deep[3, 3] = 7
    out, _ = to_grey8(deep, PERCENTILES)
    assert (out[3, 3], out[0, 0]) == (255, 0)


@pytest.mark.parametrize("mode", ["P", "1", "LA", "CMYK", "I;16"])
def test_every_pillow_mode_becomes_grey(tmp_path: Path, mode: str) -> None:
    grey = Image.fromarray(texture(0))
    name = "a.jpg" if mode == "CMYK" else "a.png"
    if mode == "I;16":
        image = Image.fromarray(texture(0).astype(np.uint16) * 257)
    elif mode == "CMYK":
        image = grey.convert("RGB").convert("CMYK")
    else:
        image = grey.convert(mode)
    image.save(tmp_path / name)
    pixels = read(tmp_path / name)
    assert pixels.shape == (160, 200)
    assert pixels.dtype == (np.uint16 if mode == "I;16" else np.uint8)
    minimum = 0.15 if mode == "1" else 0.97
    assert np.corrcoef(pixels.ravel(), texture(0).ravel())[0, 1] > minimum


def test_sixteen_bit_colour_png_keeps_its_depth(tmp_path: Path) -> None:
    import imagecodecs

    deep = texture(0).astype(np.uint16) * 256 + 3
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(np.dstack([deep] * 3)))
    np.testing.assert_array_equal(read(tmp_path / "a.png"), deep)


def test_a_palette_of_grey_gives_the_grey_values(tmp_path: Path) -> None:
    ramp = np.arange(256, dtype=np.uint16) * 257
    path = save(
        tmp_path / "a.tif", texture(0), photometric="palette", colormap=np.stack([ramp] * 3)
    )
    np.testing.assert_array_equal(read(path), texture(0))


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_channels_of_a_tiff_may_be_interleaved_or_apart(tmp_path: Path, planar: str) -> None:
    colour = np.dstack([texture(0)] * 3)
    array = np.moveaxis(colour, -1, 0) if planar == "separate" else colour
    path = save(tmp_path / "a.tif", array, photometric="rgb", planarconfig=planar)
    np.testing.assert_array_equal(read(path), texture(0))


@pytest.mark.parametrize("dtype", [np.int8, np.int16, np.int32, np.float16, np.float64, bool])
def test_every_sample_type_is_read(tmp_path: Path, dtype: type) -> None:
    source = texture(0) > 120 if dtype is bool else texture(0).astype(np.int16) - 128
    path = save(tmp_path / "a.tif", source.astype(dtype), photometric="minisblack")
    pixels = read(path).astype(float)
    assert np.corrcoef(pixels.ravel(), source.ravel().astype(float))[0, 1] > 0.999


def test_big_endian_bigtiff_with_lzw_is_read(tmp_path: Path) -> None:
    path = save(
        tmp_path / "a.tif", texture(0).astype(np.uint16), byteorder=">", bigtiff=True,
        compression="lzw", predictor=True,
    )  # fmt: skip
    np.testing.assert_array_equal(read(path), texture(0))


@pytest.mark.parametrize("method", ["median", "gaussian", "nlm"])
def test_denoising_lowers_the_noise_and_keeps_the_image(method: str) -> None:
    image = texture(0)
    out = prepare_pixels(image, replace(OPTIONS, denoise=method))
    assert out.dtype == np.uint8
    assert noise_level(out) < 0.7 * noise_level(image)
    assert np.corrcoef(out.ravel(), image.ravel())[0, 1] > 0.95


def test_the_flat_field_removes_a_slope_and_keeps_detail() -> None:
    slope = np.linspace(0.5, 1.5, 200)[None, :]
    tilted = np.clip(texture(0) * slope, 0, 255).astype(np.uint8)
    out = prepare_pixels(tilted, replace(OPTIONS, flat_field=True))

    def slope_of(image: np.ndarray) -> float:
        return float(image[:, 150:].mean() / image[:, :50].mean())

    assert slope_of(tilted) > 1.9
    assert abs(slope_of(out) / slope_of(texture(0)) - 1) < 0.35
    assert out.std() > 0.5 * texture(0).std()


def test_local_contrast_evens_out_contrast() -> None:
    image = texture(0).astype(float)
    image[:, :100] = 100 + (image[:, :100] - 100) * 0.15
    out = prepare_pixels(image.astype(np.uint8), replace(OPTIONS, local_contrast=3.0))
    before = image[:, 100:].std() / image[:, :100].std()
    assert out[:, 100:].std() / out[:, :100].std() < 0.7 * before


def test_no_change_is_asked_for_by_default() -> None:
    assert not changes_pixels(OPTIONS)
    assert changes_pixels(replace(OPTIONS, denoise="median"))


def test_changes_are_applied_recorded_and_leave_the_originals(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.jpg", texture(i), quality=95)
    before = [(folder / f"{i}.jpg").read_bytes() for i in range(3)]
    options = replace(OPTIONS, denoise="median", local_contrast=2.0)
    series = prepare_series(folder, tmp_path / "p", options)
    assert series.names == ("0.png", "1.png", "2.png")
    written = np.asarray(Image.open(tmp_path / "p/images/0.png"))
    np.testing.assert_array_equal(written, prepare_pixels(read(folder / "0.jpg"), options))
    record = json.loads((tmp_path / "p/series.json").read_text())["preparation"]
    assert record["options"]["denoise"] == "median"
    assert record["options"]["local_contrast"] == 2.0
    assert record["grey_range"]["0.png"] == [0.0, 255.0]
    assert before == [(folder / f"{i}.jpg").read_bytes() for i in range(3)]
