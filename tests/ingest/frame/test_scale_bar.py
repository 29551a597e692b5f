from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.frame.databar import (
    find_databar,
    to_levels,
)
from semsfm_colmap.ingest.frame.scale_bar import find_scale_bar
from tests.conftest import DATA


def bar_with(length: int, *, ticks: bool = True, label: bool = False) -> np.ndarray:
    bar = np.zeros((40, 600), np.uint8)
    bar[0:2] = 200
    bar[:, 0] = bar[:, 300] = bar[:, -1] = 255
    bar[20, 300:] = 255
    first = 340
    bar[30, first : first + length] = 255
    if label:
        third = length // 3
        bar[25:36, first + third : first + length - third] = 0
        bar[26:35, first + third + 4 : first + length - third - 4 : 4] = 255
    if ticks:
        bar[26:35, first] = bar[26:35, first + length - 1] = 255
    return bar


@pytest.mark.parametrize("length", [30, 101, 200])
@pytest.mark.parametrize("label", [True, False])
def test_a_scale_bar_is_measured_between_its_ticks(length: int, label: bool) -> None:
    found = find_scale_bar(bar_with(length, label=label and length > 50))
    assert found is not None
    assert found.has_marks
    assert found.length_px == length - 1


def test_a_scale_bar_without_ticks_is_measured_from_end_to_end() -> None:
    found = find_scale_bar(bar_with(120, ticks=False))
    assert found is not None
    assert (found.has_marks, found.length_px) == (False, 120)


def test_dark_writing_on_white_is_measured_too() -> None:
    found = find_scale_bar(255 - bar_with(101))
    assert found is not None
    assert found.length_px == 100


def test_frames_and_separators_are_no_scale_bars() -> None:
    bar = bar_with(0, ticks=False)
    assert find_scale_bar(bar) is None
    assert find_scale_bar(np.zeros((40, 600), np.uint8)) is None
    assert find_scale_bar(np.zeros((3, 600), np.uint8)) is None


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("name", "row", "label_um", "pixel_um"),
    [
        ("synth_pollen/images/pollen_000.png", 708, 15, 0.064655),
        ("synth_nickel/images/nickel_000.png", 708, 15, 0.084711),
        ("synth_spore/images/spore_000.png", 708, 3, 0.017021),
        ("sem_metadata/zeiss_512pix.tif", 350, 0.2, 0.011649976),
        ("sem_metadata/quanta_image.tif", 884, 100, 0.441942),
        ("sem_metadata/fei_helios_16bit.tif", 442, 500, 3.3724),
    ],
)
def test_real_and_rendered_scale_bars_are_measured_to_two_pixels(
    name: str, row: int, label_um: float, pixel_um: float
) -> None:
    raw = read_pixels(DATA / name, read_header(DATA / name, 10**9))
    assert find_databar(raw.pixels) == row
    found = find_scale_bar(to_levels(raw.pixels)[row:])
    assert found is not None
    # FEI's Helios draws arrow heads beyond the ends: 151 px for 148.
    assert abs(found.length_px - label_um / pixel_um) <= (3 if "helios" in name else 1.5)
