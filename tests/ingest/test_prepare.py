from __future__ import annotations

import os
from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.ingest.files.read import read_pixels
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import assert_left_out, prepare

OPTIONS = IngestOptions()


def test_without_a_databar_nothing_is_cut_and_a_png_is_copied_byte_for_byte(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert series.frames[0].crop_px == (0, 0, 200, 160)
    copied = (tmp_path / "p/images/0.png").read_bytes()
    assert copied == (folder / "0.png").read_bytes()


def test_a_jpeg_is_copied_byte_for_byte_or_becomes_a_png(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"plain/{i}.jpg", texture(i), quality=90)
        save(folder / f"bar/{i}.jpg", with_databar(texture(i)), quality=95)
    plain = prepare_series(folder / "plain", tmp_path / "p", OPTIONS)
    assert plain.names == ("0.jpg", "1.jpg", "2.jpg")
    copied = (tmp_path / "p/images/0.jpg").read_bytes()
    assert copied == (folder / "plain/0.jpg").read_bytes()
    bar = prepare_series(folder / "bar", tmp_path / "q", OPTIONS)
    assert bar.names == ("0.png", "1.png", "2.png")
    assert bar.frames[0].height_px == 136


def test_a_file_that_goes_away_before_it_is_copied_is_left_out(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_and_lose(path: Path, header: ImageHeader) -> RawImage:
        raw = read_pixels(path, header)
        if path.name == "lost.png":
            path.unlink()
        return raw

    save(good / "lost.png", texture(9))
    monkeypatch.setattr("semsfm_colmap.ingest.prepare.read_pixels", read_and_lose)
    series = prepare(good)
    assert_left_out(series, "lost.png", "cannot be read: No such file")


def test_a_second_run_of_the_same_series_changes_no_byte(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.tif", with_databar(texture(i)))
    prepare_series(folder, tmp_path / "p", OPTIONS)
    before = {p: p.read_bytes() for p in (tmp_path / "p").rglob("*") if p.is_file()}
    prepare_series(folder, tmp_path / "p", OPTIONS)
    assert before == {p: p.read_bytes() for p in (tmp_path / "p").rglob("*") if p.is_file()}


def test_the_originals_are_untouched(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}
    prepare_series(folder, tmp_path / "p", OPTIONS)
    assert before == {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}


def test_two_images_that_would_get_one_name_are_refused(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    save(folder / "1.jpg", with_databar(texture(7)), quality=95)
    with pytest.raises(InputError, match=r"both 1\.jpg and 1\.png would be prepared as 1\.png"):
        prepare_series(folder, tmp_path / "p", OPTIONS)


def test_progress_counts_up_to_the_total(folder: Path, tmp_path: Path) -> None:
    for i in range(4):
        save(folder / f"{i}.png", texture(i))
    seen: list[tuple[int, int]] = []
    prepare_series(folder, tmp_path / "p", OPTIONS, progress=lambda n, m: seen.append((n, m)))
    assert seen[-1] == (8, 8)
    assert [n for n, _ in seen] == sorted(n for n, _ in seen)


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
