from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.listing import find_images, source_files
from semsfm_colmap.ingest.files.mrc import read_stack_header
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.prepared import OPTIONS
from tests.ingest.stacks import textures, write_stack


def pixels(stack: Path) -> list[np.ndarray]:
    found = []
    for name in find_images(stack).names:
        path = stack / name
        found.append(read_pixels(path, read_header(path, 10**7)).pixels)
    return found


@pytest.mark.parametrize("kind", [np.int16, np.uint16, np.float32])
@pytest.mark.parametrize("order", ["<", ">"])
def test_every_section_is_an_image_with_its_highest_row_first(tmp_path, kind, order) -> None:
    images = [image.astype(kind) for image in textures()]
    stack = write_stack(tmp_path / "a.st", images, order=order, extended=bytes(160))
    assert find_images(stack).names == tuple(f"a_{k:04d}.mrc" for k in range(1, 5))
    for found, image in zip(pixels(stack), images, strict=True):
        np.testing.assert_array_equal(found, image - (image.min() if kind == np.int16 else 0))


def test_bytes_are_signed_or_unsigned_as_the_flag_or_else_the_largest_value_says(tmp_path) -> None:
    images = [image // 2 for image in textures()]  # 0 to 127: the same either way
    for flags, signed in ((1, True), (0, False)):
        stack = write_stack(tmp_path / "flag.mrc", images, imod_flags=flags)
        assert read_stack_header(stack).signed_bytes is signed
    wide = write_stack(tmp_path / "wide.mrc", textures())
    assert not read_stack_header(wide).signed_bytes
    np.testing.assert_array_equal(pixels(wide)[2], textures()[2])
    below = [image.astype(np.int16) - 128 for image in textures()]
    low = write_stack(tmp_path / "low.mrc", [image.astype(np.int8) for image in below])
    assert read_stack_header(low).signed_bytes
    np.testing.assert_array_equal(pixels(low)[1], below[1] - below[1].min())


def test_a_stack_becomes_a_series_with_its_pixel_size(tmp_path) -> None:
    stack = write_stack(tmp_path / "tilts.st", textures(), pixel_angstrom=250.0)
    series = prepare_series(stack, tmp_path / "p", OPTIONS)
    assert series.names == tuple(f"tilts_{k:04d}.png" for k in range(1, 5))
    assert series.pixel_size_um == pytest.approx(0.025, rel=1e-6)
    assert series.pixel_size_source == "MRC header"
    assert series.frames[2].source_path == str(stack / "tilts_0003.mrc")
    assert any("no tilt is known" in warning for warning in series.warnings)


def test_one_angstrom_is_what_programs_write_where_none_is_known(tmp_path) -> None:
    for angstrom in (0.0, 1.0):
        stack = write_stack(tmp_path / "a.mrc", textures(), pixel_angstrom=angstrom)
        assert read_stack_header(stack).pixel_size_um is None


def test_a_truncated_stack_is_refused_in_one_sentence(tmp_path) -> None:
    stack = write_stack(tmp_path / "a.st", textures())
    stack.write_bytes(stack.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"a\.st: the file has \d+ bytes .* truncated") as info:
        prepare_series(stack, tmp_path / "p", OPTIONS)
    assert "\n" not in str(info.value)
    stack.write_bytes(stack.read_bytes()[:1000])
    with pytest.raises(InputError, match="too few for an MRC file"):
        prepare_series(stack, tmp_path / "p", OPTIONS)


def test_a_header_that_promises_more_than_memory_holds_is_refused(tmp_path) -> None:
    stack = write_stack(tmp_path / "a.st", textures())
    stack.write_bytes(b"\xff\xff\xff\x7f" + stack.read_bytes()[4:])
    with pytest.raises(InputError, match="truncated"):
        find_images(stack)


@pytest.mark.parametrize(
    ("offset", "value", "said"),
    [
        (0, 0, "0 x 160 pixels"),
        (12, 4, "MRC mode 4 holds no grey values"),
        (12, 101, "MRC mode 101"),
        (64, 2, r"along the axes \(2, 2, 3\)"),
    ],
)
def test_what_is_no_stack_of_grey_images_is_refused(tmp_path, offset, value, said) -> None:
    stack = write_stack(tmp_path / "a.st", textures())
    raw = bytearray(stack.read_bytes())
    raw[offset : offset + 4] = value.to_bytes(4, "little")
    stack.write_bytes(raw)
    with pytest.raises(InputError, match=said):
        find_images(stack)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_header_that_lies_about_the_extended_one_takes_no_memory(tmp_path, order) -> None:
    stack = write_stack(tmp_path / "a.st", textures(), order=order)
    read_stack_header(stack)
    content = bytearray(stack.read_bytes())
    content[92:96] = struct.pack(f"{order}i", 2**31 - 1)
    stack.write_bytes(content)
    tracemalloc.start()
    with pytest.raises(UnreadableImageError, match=r"its header promises 21[0-9]{8} for 4 images"):
        read_stack_header(stack)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


def test_a_text_file_with_the_suffix_of_a_stack_is_refused(tmp_path) -> None:
    (tmp_path / "a.st").write_text("no stack " * 300, encoding="utf-8")
    with pytest.raises(UnreadableImageError):
        read_stack_header(tmp_path / "a.st")


def test_a_folder_with_two_stacks_says_to_give_one(tmp_path) -> None:
    stack = write_stack(tmp_path / "a.st", textures())
    write_stack(tmp_path / "b.st", textures())
    with pytest.raises(InputError, match=f"give {stack}"):
        prepare_series(tmp_path, tmp_path / "p", OPTIONS)


def test_a_run_depends_on_the_stack_and_on_what_lies_beside_it(tmp_path) -> None:
    stack = write_stack(tmp_path / "a.st", textures())
    for name in ("a.rawtlt", "a.st.mdoc", "other.rawtlt"):
        (tmp_path / name).write_text("", encoding="utf-8")
    assert [path.name for path in source_files(stack)] == ["a.st", "a.rawtlt", "a.st.mdoc"]
