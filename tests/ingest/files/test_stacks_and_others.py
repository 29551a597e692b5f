"""Stacks in one file, and files that no reader knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from semsfm_colmap.ingest.files.listing import find_images, source_files
from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.files.test_mrc import pixels
from tests.ingest.images import save, texture, written
from tests.ingest.prepared import prepare
from tests.ingest.stacks import textures, write_stack

OPTIONS = IngestOptions()


def pages(path: Path, count: int, first: int = 0) -> Path:
    path.parent.mkdir(exist_ok=True)
    with tifffile.TiffWriter(path) as tiff:
        for i in range(count):
            tiff.write(texture(first + i), contiguous=False)
        tiff.write(texture(9, 40, 50), contiguous=False)  # a preview
    return path


def test_a_tiff_with_several_pages_is_a_series_when_it_is_the_path(folder: Path) -> None:
    stack = pages(folder / "tilts.tif", 4)
    series = prepare_series(stack, folder.parent / "p", OPTIONS)
    assert series.names == tuple(f"tilts_000{k}.tif" for k in range(1, 5))
    found = written(folder.parent / "p/images/tilts_0003.tif")
    np.testing.assert_array_equal(found, texture(2))
    assert source_files(stack) == [stack]


def test_a_folder_with_one_stack_and_nothing_else_stands_for_it(folder: Path) -> None:
    pages(folder / "tilts.tif", 4)
    series = prepare(folder)
    assert len(series.frames) == 4
    assert series.frames[2].name == "tilts.tif/tilts_0003.tif"
    mrc = folder.parent / "mrc"
    mrc.mkdir()
    write_stack(mrc / "a.st", textures(), pixel_angstrom=250.0)
    assert len(find_images(mrc).names) == 4
    assert prepare_series(mrc, folder.parent / "q", OPTIONS).pixel_size_um == pytest.approx(0.025)


def test_pages_of_single_images_are_counted_and_said(good: Path) -> None:
    pages(good / "two.tif", 2, first=5)
    rows = {row.name: row for row in inspect_images(good, OPTIONS).rows}
    assert rows["two.tif"].num_pages == 2
    assert "the file holds 2 pages of one size" in rows["two.tif"].warnings[0]
    assert rows["good0.png"].num_pages == 1


def test_files_that_are_not_read_are_named(good: Path) -> None:
    (good / "a.dm3").write_bytes(b"\x00\x00\x00\x03")
    (good / "b.jxl").write_bytes(b"\xff\x0a")
    write_stack(good / "c.mrc", textures())
    (good / "notes.txt").write_text("no image")
    warnings = find_images(good).warnings
    assert (
        "a.dm3, b.jxl: passed over, the format is not read; save as TIFF or PNG to use them."
        in (warnings)
    )
    assert any(w.startswith("c.mrc: passed over, a stack is a series") for w in warnings)
    assert not any("notes" in w for w in warnings)
    assert any("a.dm3" in remark for remark in inspect_images(good, OPTIONS).remarks)


def test_unsigned_bytes_under_the_header_of_signed_ones_are_not_torn(tmp_path: Path) -> None:
    images = [image.view(np.int8) for image in textures()]
    stack = write_stack(tmp_path / "wrapped.mrc", images)
    for found, image in zip(pixels(stack), textures(), strict=True):
        np.testing.assert_array_equal(found, image)


def test_inspect_says_the_scan_rotation_and_that_no_pixel_size_is_known(good: Path) -> None:
    remarks = inspect_images(good, OPTIONS).remarks
    assert any("no file records a pixel size" in remark for remark in remarks)
    save(good / "good3.png", texture(3))
    given = inspect_images(good, IngestOptions(pixel_size_um=0.1)).remarks
    assert not any("pixel size" in remark for remark in given)
