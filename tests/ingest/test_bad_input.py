"""The rows of the table in docs/ingest.md.

Each kind of bad input is one sentence, and what can go on goes on.
"""

from __future__ import annotations

import os
import struct
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import InputError, SemSfmError, UsageError
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.files.raster import read_header
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.types import SemSeries
from tests.ingest import vendor_files as vendor
from tests.ingest.conftest import save, texture, with_databar

OPTIONS = IngestOptions()


@pytest.fixture
def good(folder: Path) -> Path:
    """Three images that are in order."""
    for i in range(3):
        save(folder / f"good{i}.png", texture(i))
    return folder


def prepare(folder: Path, options: IngestOptions = OPTIONS) -> SemSeries:
    return prepare_series(folder, folder.parent / "project", options)


def assert_left_out(series: SemSeries, name: str, sentence: str) -> None:
    """The good images are there, the bad one is named in exactly one sentence."""
    assert series.names == ("good0.png", "good1.png", "good2.png")
    about = [w for w in series.warnings if w.startswith(f"{name}: ")]
    assert len(about) == 1
    assert sentence in about[0]
    assert about[0].rstrip().endswith(".")
    assert "\n" not in about[0]


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


@pytest.mark.parametrize("compression", [None, "lzw", "zlib"])
def test_a_truncated_tiff_is_left_out(good: Path, compression: str | None) -> None:
    path = save(good / "bad.tif", texture(9), compression=compression, rowsperstrip=16)
    content = path.read_bytes()
    # tifffile writes the directory first, so that the cut goes through the pixels.
    path.write_bytes(content[: len(content) // 2])
    assert_left_out(prepare(good), "bad.tif", "damaged")


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
    tracemalloc.start()
    series = prepare(good)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_left_out(series, name, "100000 x 100000 pixels, more than the limit of 400000000")
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
    tracemalloc.start()
    series = prepare(good)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_left_out(series, name, "bytes cannot hold 15000 x 15000 pixels")
    assert peak < 50e6


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


@pytest.mark.parametrize("value", [0, 255])
def test_a_black_or_white_frame_is_left_out(good: Path, value: int) -> None:
    save(good / "bad.png", np.full((160, 200), value, np.uint8))
    assert_left_out(prepare(good), "bad.png", f"every pixel has the value {value}")


def test_a_frame_that_is_black_above_its_databar_is_left_out(folder: Path) -> None:
    for i in range(3):
        save(folder / f"good{i}.png", with_databar(texture(i)))
    save(folder / "bad.png", with_databar(np.zeros((160, 200), np.uint8)))
    assert_left_out(prepare(folder), "bad.png", "the cropped image")


def test_a_copy_of_another_frame_is_left_out(good: Path) -> None:
    save(good / "z.tif", texture(1))
    assert_left_out(prepare(good), "z.tif", "the pixels are those of good1.png")


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


def magnified(folder: Path, sizes_um: list[float]) -> Path:
    for i, um in enumerate(sizes_um):
        tag = vendor.fei(pixel_m=um * 1e-6)
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    return folder


def test_another_magnification_is_left_out_in_one_sentence(folder: Path) -> None:
    series = prepare(magnified(folder, [0.05, 0.025, 0.025, 0.0251, 0.1]))
    assert series.names == ("1.tif", "2.tif", "3.tif")
    assert series.pixel_size_um == pytest.approx(0.025)
    about = [w for w in series.warnings if "magnification" in w]
    assert about == [
        "0.tif, 4.tif: a pixel size of 0.05 to 0.1 um is recorded, but 0.025 um for most images, "
        "and views of another magnification cannot be placed; give pixel_size_um or a table if "
        "that is wrong. Left out."
    ]


def test_a_slightly_other_magnification_goes_on_with_one_sentence(folder: Path) -> None:
    series = prepare(magnified(folder, [0.0253, 0.025, 0.025, 0.025]))
    assert len(series.names) == 4
    (about,) = [w for w in series.warnings if "magnification" in w]
    assert about.startswith("0.tif: the recorded pixel size differs")


def test_the_user_s_pixel_size_keeps_images_whose_headers_disagree(folder: Path) -> None:
    options = replace(OPTIONS, pixel_size_um=0.025)
    assert len(prepare(magnified(folder, [0.05, 0.025, 0.025]), options).names) == 3


def test_three_magnifications_in_three_images_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"only 1 of 3 images .* another magnification"):
        prepare(magnified(folder, [0.1, 0.05, 0.025]))


def test_equal_names_in_subfolders_stay_apart(folder: Path) -> None:
    for i in range(3):
        save(folder / f"run{i}/a.png", texture(i))
    series = prepare(folder)
    assert series.names == ("run0/a.png", "run1/a.png", "run2/a.png")
    written = np.asarray(Image.open(folder.parent / "project/images/run2/a.png"))
    np.testing.assert_array_equal(written, texture(2))


def test_spaces_unicode_and_leading_dashes_are_kept(folder: Path) -> None:
    names = ["-rf.png", "Körner 日本 1.png", "a b.png", "#x%20.png"]
    for i, name in enumerate(names):
        save(folder / name, texture(i))
    series = prepare(folder)
    assert set(series.names) == set(names)
    for i, name in enumerate(names):
        written = np.asarray(Image.open(folder.parent / "project/images" / name))
        np.testing.assert_array_equal(written, texture(i))
    assert any("spaces" in w for w in series.warnings)


def test_names_that_are_no_utf8_or_hold_control_characters_are_left_out(good: Path) -> None:
    save(good / "a\nb.png", texture(8))
    try:
        os.link(good / "good0.png", os.fsencode(good) + b"/\xff.png")
    except OSError:
        pytest.skip("the file system takes no such names")
    series = prepare(good)
    assert series.names == ("good0.png", "good1.png", "good2.png")
    assert any("control characters" in w for w in series.warnings)
    assert any("not valid UTF-8" in w for w in series.warnings)
    for warning in series.warnings:
        warning.encode("utf-8")


def test_a_loop_of_links_ends(good: Path) -> None:
    (good / "sub").mkdir()
    (good / "sub/loop").symlink_to(good)
    (good / "self").symlink_to(good / "self")
    assert prepare(good).names == ("good0.png", "good1.png", "good2.png")


def test_a_link_that_leads_nowhere_is_left_out(good: Path) -> None:
    (good / "bad.png").symlink_to(good / "none.png")
    assert_left_out(prepare(good), "bad.png", "a link that leads nowhere")


def test_a_pipe_with_an_image_suffix_does_not_block(good: Path) -> None:
    os.mkfifo(good / "bad.png")
    os.mkfifo(good / "good0.txt")  # where a vendor's text would be
    assert_left_out(prepare(good), "bad.png", "not a regular file")


def test_an_unreadable_file_is_left_out(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(good / "bad.png", texture(9)).chmod(0)
    opened = Path.open

    def refuse(self: Path, *args: object, **options: object) -> object:
        if self.name == "bad.png":  # the tests may run as a user whom permissions do not stop
            raise PermissionError(13, "Permission denied")
        return opened(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "open", refuse)
    assert_left_out(prepare(good), "bad.png", "cannot be opened (Permission denied)")


def test_an_unreadable_folder_is_a_usage_error(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_args, **_options: False)
    with pytest.raises(UsageError, match="permission denied"):
        prepare(good)


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


def test_what_is_odd_about_single_images_is_said_once_for_all_of_them(good: Path) -> None:
    for i in range(5):
        save(good / "x.png", texture(20 + i)).rename(good / f"odd{i}.tif")
    said = [w for w in prepare(good).warnings if "the content is PNG" in w]
    assert said == [
        "odd0.tif, odd1.tif, odd2.tif and 2 more: the content is PNG, not what the suffix says."
    ]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_undone_as_pillow_does(good: Path, orientation: int) -> None:
    from PIL import ImageOps

    from semsfm_colmap.ingest.files.raster import read_pixels

    path = save(
        good / "turned.tif", texture(9), metadata=None,
        extratags=[(274, 3, 1, orientation, True)],
    )  # fmt: skip
    ours = read_pixels(path, read_header(path, 10**9)).pixels
    plain = Image.fromarray(texture(9))
    plain.getexif()[274] = orientation
    np.testing.assert_array_equal(ours, np.asarray(ImageOps.exif_transpose(plain)))


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


def test_hidden_files_are_no_images(good: Path) -> None:
    save(good / "x.png", texture(9)).rename(good / "._good0.png")
    assert find_images(good).names == ("good0.png", "good1.png", "good2.png")


def test_a_project_inside_the_image_folder_is_not_read_back(good: Path) -> None:
    first = prepare_series(good, good / "project", OPTIONS)
    second = prepare_series(good, good / "project", OPTIONS)
    assert first.names == second.names == ("good0.png", "good1.png", "good2.png")


def test_a_project_of_another_run_inside_the_image_folder_is_passed_by(good: Path) -> None:
    prepare_series(good, good / "old", OPTIONS)
    assert find_images(good).names == ("good0.png", "good1.png", "good2.png")
    in_place = prepare_series(good, good, OPTIONS)
    assert in_place.names == ("good0.png", "good1.png", "good2.png")
    assert find_images(good).names == ("good0.png", "good1.png", "good2.png")
    # A project alone is looked into: a person may inspect what was prepared.
    assert len(find_images(good / "old").names) == 3


def test_a_damaged_series_file_of_an_earlier_run_does_not_matter(good: Path) -> None:
    prepare(good)
    (good.parent / "project/series.json").write_text('{"format": "semsfm-series", "fra')
    assert len(prepare(good).frames) == 3


def test_an_output_that_cannot_be_written_is_a_usage_error(good: Path) -> None:
    (good.parent / "project").write_text("a file where the folder should be")
    with pytest.raises(UsageError, match="cannot be written"):
        prepare(good)


def test_an_interrupted_write_leaves_no_half_file(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        prepare(good)
    left = [p for p in (good.parent / "project").rglob("*") if p.is_file()]
    assert left == []


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"pixel_size_um": 0.0}, "pixel_size_um"),
        ({"pixel_size_um": float("nan")}, "pixel_size_um"),
        ({"scale_bar_um": -1.0}, "scale_bar_um"),
        ({"range_percentiles": (50.0, 50.0)}, "range_percentiles"),
        ({"max_image_pixels": 0}, "max_image_pixels"),
        ({"flat_field_scale": 0.0}, "flat_field_scale"),
        ({"local_contrast": -1.0}, "local_contrast"),
        ({"tilt_step_deg": 0.0}, "tilt_step_deg"),
        ({"tilt_sigma_deg": -0.1}, "tilt_sigma_deg"),
        ({"tilt_axis": "z"}, "tilt_axis"),
    ],
)
def test_options_that_no_series_can_have_are_usage_errors(
    good: Path, values: dict[str, object], sentence: str
) -> None:
    with pytest.raises(UsageError, match=sentence):
        prepare(good, replace(OPTIONS, **values))  # type: ignore[arg-type]


def test_the_exit_codes_are_those_of_the_design() -> None:
    assert InputError("x").exit_code == 1
    assert UsageError("x").exit_code == 2
    assert issubclass(UnreadableImageError, SemSfmError)
