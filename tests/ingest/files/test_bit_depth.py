from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files.bit_depth import to_grey8
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture, written

OPTIONS = IngestOptions()

PERCENTILES = IngestOptions().range_percentiles


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


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32, np.float32])
def test_deep_images_are_reduced_by_robust_percentiles(
    folder: Path, tmp_path: Path, dtype: type
) -> None:
    for i in range(3):
        deep = (texture(i).astype(np.float64) * 10 + 300).astype(dtype)
        deep[3, 3] = 60_000  # a hot pixel must not take the range
        save(folder / f"{i}.tif", deep)
    prepare_series(folder, tmp_path / "p", OPTIONS)
    for i in range(3):
        out = written(tmp_path / f"p/images/{i}.tif").astype(float)
        assert out.dtype == np.float64
        assert np.corrcoef(out[5:].ravel(), texture(i)[5:].astype(float).ravel())[0, 1] > 0.99
        assert out.std() > 30
