from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.geometry.pixel_noise import noise_level
from semsfm_colmap.ingest.frame.enhance import changes_pixels, prepare_pixels
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import pixels_of, save, texture

OPTIONS = IngestOptions()


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
    np.testing.assert_array_equal(written, prepare_pixels(pixels_of(folder / "0.jpg"), options))
    record = json.loads((tmp_path / "p/series.json").read_text())["preparation"]
    assert record["options"]["denoise"] == "median"
    assert record["options"]["local_contrast"] == 2.0
    assert record["grey_range"]["0.png"] == [0.0, 255.0]
    assert before == [(folder / f"{i}.jpg").read_bytes() for i in range(3)]
