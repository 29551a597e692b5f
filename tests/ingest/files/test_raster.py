from __future__ import annotations

import struct
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import pixels_of, save, texture, written
from tests.ingest.prepared import assert_left_out, prepare

OPTIONS = IngestOptions()


def png_header(width: int, height: int) -> bytes:
    """A PNG that claims a size and holds next to nothing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(bytes(100)))
        + chunk(b"IEND", b"")
    )


def tiff_header(width: int, height: int) -> bytes:
    """A TIFF that claims a size and holds next to nothing."""
    entries = [
        (256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1),
        (273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, height), (279, 4, 1, 100),
    ]  # fmt: skip
    directory = struct.pack("<H", len(entries)) + b"".join(
        struct.pack("<HHII", *entry) for entry in entries
    )
    return b"II*\x00" + struct.pack("<I", 108) + bytes(100) + directory + struct.pack("<I", 0)


def test_a_zero_byte_file_is_left_out(good: Path) -> None:
    (good / "bad.tif").write_bytes(b"")
    assert_left_out(prepare(good), "bad.tif", "is empty")


@pytest.mark.parametrize("name", ["bad.png", "bad.jpg"])
def test_a_truncated_png_or_jpeg_is_left_out(good: Path, name: str) -> None:
    path = save(good / name, texture(9))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert_left_out(prepare(good), name, "truncated")


def test_text_with_an_image_suffix_is_left_out(good: Path) -> None:
    (good / "bad.png").write_text("not an image")
    assert_left_out(prepare(good), "bad.png", "is not a PNG, JPEG, TIFF or BMP image")


def test_a_wrong_suffix_is_read_by_content_and_said(good: Path) -> None:
    save(good / "x.png", texture(9)).rename(good / "odd.tif")
    series = prepare(good)
    frame = series.frames[-1]
    assert frame.name == "odd.tif"
    assert frame.warnings == ("the content is PNG, not what the suffix says",)
    import tifffile

    written = tifffile.imread(good.parent / "project/images/odd.tif")
    np.testing.assert_array_equal(written, texture(9))


@pytest.mark.parametrize("make", [png_header, tiff_header])
def test_a_huge_header_is_refused_before_memory_is_taken(good: Path, make) -> None:  # type: ignore[no-untyped-def]
    name = "bad.png" if make is png_header else "bad.tif"
    (good / name).write_bytes(make(100_000, 100_000))
    sentence = "100000 x 100000 pixels, more than the limit of 400000000"
    assert_left_out(prepare(good), name, sentence)
    tracemalloc.start()
    with pytest.raises(UnreadableImageError, match=sentence):
        read_header(good / name, OPTIONS.max_image_pixels)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_the_limit_on_pixels_can_be_raised_and_lowered(good: Path) -> None:
    with pytest.raises(InputError, match=r"none of the 3 images .* more than the limit of 100"):
        prepare(good, replace(OPTIONS, max_image_pixels=100))
    assert len(prepare(good, replace(OPTIONS, max_image_pixels=10**12)).frames) == 3


@pytest.mark.parametrize("make", [png_header, tiff_header])
def test_a_header_that_promises_more_than_the_file_can_hold_takes_no_memory(
    good: Path, make
) -> None:  # type: ignore[no-untyped-def]
    name = "bad.png" if make is png_header else "bad.tif"
    (good / name).write_bytes(make(15_000, 15_000))
    sentence = "bytes cannot hold 15000 x 15000 pixels"
    assert_left_out(prepare(good), name, sentence)
    tracemalloc.start()
    with pytest.raises(UnreadableImageError, match=sentence):
        read_pixels(good / name, read_header(good / name, OPTIONS.max_image_pixels))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


@pytest.mark.parametrize("make", [png_header, tiff_header])
@pytest.mark.parametrize("size", [(0, 10), (10, 0)])
def test_a_header_without_pixels_is_refused(tmp_path: Path, make, size) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "bad"
    path.write_bytes(make(*size))
    with pytest.raises(UnreadableImageError):
        read_header(path, 10**9)


def test_nan_pixels_become_dark_and_are_counted(good: Path) -> None:
    image = texture(9).astype(np.float32)
    image[10:20, 10:20] = np.nan
    image[0, 0] = np.inf
    save(good / "nan.tif", image)
    series = prepare(good)
    assert "101 pixels are nan or infinite" in series.frames[-1].warnings[0]
    import tifffile

    written = tifffile.imread(good.parent / "project/images/nan.tif")
    assert written[15, 15] == 0
    assert written.std() > 20


def test_an_image_of_nothing_but_nan_is_left_out(good: Path) -> None:
    save(good / "bad.tif", np.full((160, 200), np.nan, np.float32))
    assert_left_out(prepare(good), "bad.tif", "every pixel is nan")


def test_an_unreadable_file_is_left_out(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(good / "bad.png", texture(9)).chmod(0)
    opened = Path.open

    def refuse(self: Path, *args: object, **options: object) -> object:
        if self.name == "bad.png":  # the tests may run as a user whom permissions do not stop
            raise PermissionError(13, "Permission denied")
        return opened(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(UnreadableImageError, match=r"cannot be opened \(Permission denied\)"):
        read_header(good / "bad.png", 10**9)


def test_a_colour_photograph_is_turned_grey(good: Path) -> None:
    colour = np.dstack([texture(7), texture(8), texture(9)])
    save(good / "colour.png", colour)
    prepare(good)
    written = np.asarray(Image.open(good.parent / "project/images/colour.png"))
    expected = np.rint(colour @ np.array([0.299, 0.587, 0.114]))
    assert np.abs(written - expected).max() <= 1


def test_an_orientation_asked_for_by_the_file_is_obeyed_and_said(good: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6  # show turned by 90 degrees clockwise
    Image.fromarray(texture(9)).save(good / "turned.jpg", exif=exif, quality=95)
    frame = prepare(good).frames[-1]
    assert (frame.name, frame.width_px, frame.height_px) == ("turned.png", 160, 200)
    assert "tilt axis is turned" in frame.warnings[0]
    written = np.asarray(Image.open(good.parent / "project/images/turned.png")).astype(float)
    assert np.corrcoef(written.ravel(), np.rot90(texture(9), -1).ravel())[0, 1] > 0.98


def test_the_orientation_of_a_png_is_obeyed_too(good: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6
    Image.fromarray(texture(9)).save(good / "turned.png", exif=exif)
    series = prepare(good)
    assert (series.frames[-1].width_px, series.frames[-1].height_px) == (160, 200)
    assert any("turned.png: the file asks to be shown turned" in w for w in series.warnings)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_undone_as_pillow_does(good: Path, orientation: int) -> None:
    from PIL import ImageOps

    path = save(
        good / "turned.tif", texture(9), metadata=None,
        extratags=[(274, 3, 1, orientation, True)],
    )  # fmt: skip
    ours = read_pixels(path, read_header(path, 10**9)).pixels
    plain = Image.fromarray(texture(9))
    plain.getexif()[274] = orientation
    np.testing.assert_array_equal(ours, np.asarray(ImageOps.exif_transpose(plain)))


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
    pixels = pixels_of(tmp_path / name)
    assert pixels.shape == (160, 200)
    assert pixels.dtype == (np.uint16 if mode == "I;16" else np.uint8)
    minimum = 0.15 if mode == "1" else 0.97
    assert np.corrcoef(pixels.ravel(), texture(0).ravel())[0, 1] > minimum


def test_sixteen_bit_colour_png_keeps_its_depth(tmp_path: Path) -> None:
    import imagecodecs

    deep = texture(0).astype(np.uint16) * 256 + 3
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(np.dstack([deep] * 3)))
    np.testing.assert_array_equal(pixels_of(tmp_path / "a.png"), deep)


def test_grey_stored_as_rgb_and_rgba_comes_out_unchanged(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        grey = texture(i)
        alpha = np.full_like(grey, 255)
        save(folder / f"{i}.png", np.dstack([grey, grey, grey, alpha]))
        other = np.dstack([texture(i + 10)] * 3)
        save(folder / f"{i}.tif", other, photometric="rgb", compression="lzw")
    prepare_series(folder, tmp_path / "p", OPTIONS)
    for i in range(3):
        np.testing.assert_array_equal(written(tmp_path / f"p/images/{i}.png"), texture(i))
        np.testing.assert_array_equal(written(tmp_path / f"p/images/{i}.tif"), texture(i + 10))
