"""Files that end the process that reads them are named, and the rest goes on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files import raster
from semsfm_colmap.ingest.files.read import read_header, read_pixels
from tests.ingest.files.dying import read_or_die
from tests.ingest.images import save, texture
from tests.ingest.prepared import assert_left_out, prepare


def test_a_file_that_kills_its_decoder_is_left_out_and_the_rest_goes_on(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(good / "a_kills.tif", texture(9))
    monkeypatch.setattr(raster, "read_pixels", read_or_die)
    series = prepare(good)
    assert_left_out(series, "a_kills.tif", "the pixels ended the process that decoded them")
    assert len(series.frames) == 3


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.jpg"])
def test_pixels_are_those_that_are_read_in_this_process(tmp_path: Path, name: str) -> None:
    image = np.repeat(texture(3)[..., None], 3, axis=2)
    image[4:8, 10:90] = (255, 0, 0)  # drawn
    path = save(tmp_path / name, image)
    header = read_header(path, 10**9)
    assert header == raster.read_header(path, 10**9)
    found, here = read_pixels(path, header), raster.read_pixels(path, header)
    np.testing.assert_array_equal(found.pixels, here.pixels)
    assert found.pixels.dtype == here.pixels.dtype
    assert (found.coloured is None) == (here.coloured is None)
    if found.coloured is not None:
        np.testing.assert_array_equal(found.coloured, here.coloured)


def test_a_relative_path_is_one_of_the_folder_that_the_caller_is_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for side in (40, 50):
        (tmp_path / str(side)).mkdir()
        save(tmp_path / str(side) / "a.tif", texture(1)[:side])
        monkeypatch.chdir(tmp_path / str(side))
        assert read_header(Path("a.tif"), 10**9).height == side


def test_many_threads_read_at_once(tmp_path: Path) -> None:
    paths = [save(tmp_path / f"{k}.png", texture(k)) for k in range(6)] * 4
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda p: read_pixels(p, read_header(p, 10**9)).pixels, paths))
    for path, pixels in zip(paths, found, strict=True):
        np.testing.assert_array_equal(pixels, texture(int(path.stem)))
