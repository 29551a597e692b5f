from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.frame.databar import find_databar
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.conftest import DATA
from tests.ingest.images import save, texture, with_databar, written
from tests.ingest.prepared import assert_left_out, prepare

OPTIONS = IngestOptions()


def test_mixed_sizes_go_on_with_one_sentence(good: Path) -> None:
    save(good / "small.png", texture(9, 100, 120))
    series = prepare(good)
    assert len(series.frames) == 4
    about = [w for w in series.warnings if "small.png" in w]
    assert about == [
        "small.png: 120 x 100 pixels but most images have 200 x 160; kept, check that they belong "
        "to the series."
    ]


def test_databars_are_cut_by_size_group(folder: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
        save(folder / f"large{i}.png", with_databar(texture(10 + i, 240, 300), rows=40))
    series = prepare(folder)
    assert {f.crop_px for f in series.frames} == {(0, 0, 200, 136), (0, 0, 300, 200)}


def test_an_image_too_small_for_features_is_left_out(good: Path) -> None:
    save(good / "bad.png", texture(9, 20, 20))
    assert_left_out(prepare(good), "bad.png", "20 x 20 pixels are too few")


def test_a_frame_whose_databar_is_hidden_is_cut_like_the_others(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(4):
        image = with_databar(texture(i))
        if i == 2:
            image[130:140] = texture(9)[130:140]  # something over the edge
            image[150:] = texture(8)[150:]
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert {frame.crop_px for frame in series.frames} == {(0, 0, 200, 136)}


def test_a_databar_without_edge_on_clipped_black_is_found_from_many_frames(
    folder: Path, tmp_path: Path
) -> None:
    rows, columns = np.indices((160, 200))
    disc = (rows - 70) ** 2 + (columns - 100) ** 2 < 50**2
    for i in range(6):
        image = with_databar((texture(i) * disc).astype(np.uint8), line=False)
        assert find_databar(image) is None  # one frame cannot tell
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    (crop,) = {frame.crop_px for frame in series.frames}
    assert 136 <= crop[3] <= 142  # above the first writing, below the specimen


def test_the_databar_is_cut_off_and_names_are_kept(folder: Path, tmp_path: Path) -> None:
    for i in (1, 2, 10):
        save(folder / f"a{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert series.names == ("a1.png", "a2.png", "a10.png")
    assert {f.crop_px for f in series.frames} == {(0, 0, 200, 136)}
    for name, i in zip(series.names, (1, 2, 10), strict=True):
        np.testing.assert_array_equal(written(tmp_path / "p/images" / name), texture(i)[:136])


def test_a_crop_overrides_the_databar(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", replace(OPTIONS, crop=(10, 20, 110, 90)))
    assert series.frames[0].crop_px == (10, 20, 110, 90)
    np.testing.assert_array_equal(written(tmp_path / "p/images/0.png"), texture(0)[20:90, 10:110])


@pytest.mark.parametrize("crop", [(5, 5, 5, 50), (50, 0, 10, 40), (-1, 0, 40, 40)])
def test_an_empty_or_reversed_crop_is_a_usage_error(
    folder: Path, tmp_path: Path, crop: tuple[int, int, int, int]
) -> None:
    with pytest.raises(UsageError, match="x0 y0 x1 y1"):
        prepare_series(folder, tmp_path / "p", replace(OPTIONS, crop=crop))


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("series", "crop"),
    [
        ("synth_pollen/images", (0, 0, 1024, 708)),
        ("synth_nickel/images", (0, 0, 1024, 708)),
        ("synth_spore/images", (0, 0, 1024, 708)),
        ("sem_quartz3", (0, 0, 1200, 1200)),
        ("sem_pot1", (0, 0, 768, 715)),
        ("hotel/images", (0, 0, 512, 480)),
        ("temple_ring", (0, 0, 640, 480)),
    ],
)
def test_databars_are_found_to_the_row_and_none_invented(
    series: str, crop: tuple[int, int, int, int], tmp_path: Path
) -> None:
    result = prepare_series(DATA / series, tmp_path / "p", OPTIONS)
    assert {frame.crop_px for frame in result.frames} == {crop}
    assert not [w for frame in result.frames for w in frame.warnings]
