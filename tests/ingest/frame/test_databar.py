from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.frame.databar import agree_on_databar, find_databar, looks_drawn
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture, with_databar


@pytest.mark.parametrize("background", [0, 40, 255])
@pytest.mark.parametrize("line", [True, False])
@pytest.mark.parametrize("rows", [14, 24, 50])
def test_the_databar_is_found_to_the_row(background: int, line: bool, rows: int) -> None:
    if rows < 24:
        image = with_databar(texture(1), 24, background=background, line=line)[: 160 - 24 + rows]
        expected = 136
    else:
        image = with_databar(texture(1), rows, background=background, line=line)
        expected = 160 - rows
    assert find_databar(image) == expected


def test_a_databar_that_floats_above_the_bottom_is_found() -> None:
    image = with_databar(texture(1), background=255)
    image[-1] = texture(1)[-1]
    image[136:, 0] = texture(1)[136:, 0]
    assert find_databar(image) == 136


def test_a_databar_in_the_ends_of_16_bits_is_found() -> None:
    image = texture(1).astype(np.uint16) * 12
    bar = with_databar(texture(1))[136:].astype(np.uint16) * 257
    image[136:] = bar
    assert find_databar(image) == 136


@pytest.mark.parametrize("quality", [75, 90, 98])
def test_a_databar_survives_jpeg(tmp_path: Path, quality: int) -> None:
    path = save(tmp_path / "a.jpg", with_databar(texture(1)), quality=quality)
    raw = read_pixels(path, read_header(path, 10**9))
    assert find_databar(raw.pixels, lossy=True) == 136


def test_no_databar_is_invented_in_texture() -> None:
    for seed in range(20):
        assert find_databar(texture(seed)) is None


def test_a_specimen_on_clipped_black_is_no_databar() -> None:
    rows, columns = np.indices((160, 200))
    specimen = texture(1) * ((rows - 70) ** 2 + (columns - 100) ** 2 < 55**2)
    assert find_databar(specimen.astype(np.uint8)) is None
    standing = texture(1) * (abs(columns - 100) < 40 - rows // 8)  # reaches the bottom
    assert find_databar(standing.astype(np.uint8)) is None


def test_black_padding_without_writing_is_no_databar() -> None:
    image = texture(1)
    image[140:] = 0
    assert find_databar(image) is None


def test_a_databar_below_a_clipped_black_background_is_found_by_its_line() -> None:
    rows, columns = np.indices((160, 200))
    specimen = texture(1) * ((rows - 70) ** 2 + (columns - 100) ** 2 < 55**2)
    assert find_databar(with_databar(specimen.astype(np.uint8))) == 136


@pytest.mark.parametrize("shape", [(1, 1), (3, 300), (300, 3), (20, 20)])
def test_tiny_images_have_no_databar(shape: tuple[int, int]) -> None:
    assert find_databar(np.zeros(shape, np.uint8)) is None


def test_frames_vote_on_the_databar() -> None:
    assert agree_on_databar([136, 136, None, 140]) == 136
    assert agree_on_databar([None, None, None, 136]) is None
    assert agree_on_databar([136, None]) == 136
    assert agree_on_databar([]) is None


def test_a_known_height_is_believed_only_where_the_rows_look_drawn() -> None:
    assert looks_drawn(with_databar(texture(1)), 136)
    assert not looks_drawn(texture(1), 136)
    assert not looks_drawn(with_databar(texture(1)), 120)


def test_a_coloured_databar_without_exact_background_is_found(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        image = np.repeat(texture(i)[..., None], 3, axis=2)
        ramp = np.repeat(np.arange(60, 130, 7), 20).astype(np.uint8)  # in ten steps of blue
        image[136:, :, 0], image[136:, :, 1], image[136:, :, 2] = 10, ramp // 2, ramp
        image[142:150, 10:100:5] = 255
        assert find_databar(image.mean(axis=2)) is None
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert {frame.crop_px for frame in series.frames} == {(0, 0, 200, 136)}
    assert not list((tmp_path / "p").glob("masks/*"))
