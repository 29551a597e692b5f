from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import pixels_of, save, texture, written
from tests.ingest.prepared import assert_left_out, prepare

OPTIONS = IngestOptions()


@pytest.mark.parametrize("compression", [None, "lzw", "zlib"])
def test_a_truncated_tiff_is_left_out(good: Path, compression: str | None) -> None:
    path = save(good / "bad.tif", texture(9), compression=compression, rowsperstrip=16)
    content = path.read_bytes()
    # tifffile writes the directory first, so that the cut goes through the pixels.
    path.write_bytes(content[: len(content) // 2])
    assert_left_out(prepare(good), "bad.tif", "damaged")


def test_a_tiff_of_65535_channels_takes_no_memory(good: Path) -> None:
    import tifffile

    path = save(good / "bad.tif", texture(9))
    with tifffile.TiffFile(path, mode="r+b") as tiff:
        tiff.pages[0].tags[277].overwrite(65535)
    tracemalloc.start()
    series = prepare(good)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert series.names == ("good0.png", "good1.png", "good2.png")
    assert any(w.startswith("bad.tif: ") for w in series.warnings)
    assert peak < 50e6


def test_a_damaged_second_page_does_not_spoil_the_first(good: Path) -> None:
    import tifffile

    path = good / "pages.tif"
    with tifffile.TiffWriter(path) as tiff:
        tiff.write(texture(9))
        tiff.write(texture(8))
    with tifffile.TiffFile(path) as tiff:
        offset = tiff.pages[1].offset
    content = bytearray(path.read_bytes())
    content[offset : offset + 2] = b"\xff\xff"
    path.write_bytes(bytes(content))
    assert prepare(good).names[-1] == "pages.tif"


def test_a_palette_of_grey_gives_the_grey_values(tmp_path: Path) -> None:
    ramp = np.arange(256, dtype=np.uint16) * 257
    path = save(
        tmp_path / "a.tif", texture(0), photometric="palette", colormap=np.stack([ramp] * 3)
    )
    np.testing.assert_array_equal(pixels_of(path), texture(0))


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_channels_of_a_tiff_may_be_interleaved_or_apart(tmp_path: Path, planar: str) -> None:
    colour = np.dstack([texture(0)] * 3)
    array = np.moveaxis(colour, -1, 0) if planar == "separate" else colour
    path = save(tmp_path / "a.tif", array, photometric="rgb", planarconfig=planar)
    np.testing.assert_array_equal(pixels_of(path), texture(0))


@pytest.mark.parametrize("dtype", [np.int8, np.int16, np.int32, np.float16, np.float64, bool])
def test_every_sample_type_is_read(tmp_path: Path, dtype: type) -> None:
    source = texture(0) > 120 if dtype is bool else texture(0).astype(np.int16) - 128
    path = save(tmp_path / "a.tif", source.astype(dtype), photometric="minisblack")
    pixels = pixels_of(path).astype(float)
    assert np.corrcoef(pixels.ravel(), source.ravel().astype(float))[0, 1] > 0.999


def test_big_endian_bigtiff_with_lzw_is_read(tmp_path: Path) -> None:
    path = save(
        tmp_path / "a.tif", texture(0).astype(np.uint16), byteorder=">", bigtiff=True,
        compression="lzw", predictor=True,
    )  # fmt: skip
    np.testing.assert_array_equal(pixels_of(path), texture(0))


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "lzw"},
        {"compression": "zlib", "predictor": True},
        {"byteorder": ">"},
        {"bigtiff": True},
        {"photometric": "miniswhite"},
        {"rowsperstrip": 7},
        {"tile": (64, 64)},
    ],
    ids=lambda value: next(iter(value)),
)
def test_every_flavour_of_tiff_gives_the_same_pixels(
    folder: Path, tmp_path: Path, options: dict[str, object]
) -> None:
    for i in range(3):
        stored = 255 - texture(i) if "photometric" in options else texture(i)
        save(folder / f"{i}.tif", stored, **options)
    prepare_series(folder, tmp_path / "p", OPTIONS)
    np.testing.assert_array_equal(written(tmp_path / "p/images/1.tif"), texture(1))


def test_of_a_multi_page_tiff_the_first_full_size_page_is_taken(
    folder: Path, tmp_path: Path
) -> None:
    import tifffile

    for i in range(3):
        with tifffile.TiffWriter(folder / f"{i}.tif") as tiff:
            tiff.write(texture(i)[::4, ::4], subfiletype=1)
            tiff.write(texture(i))
            tiff.write(texture(99))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert (series.frames[0].width_px, series.frames[0].height_px) == (200, 160)
    np.testing.assert_array_equal(written(tmp_path / "p/images/0.tif"), texture(0))
