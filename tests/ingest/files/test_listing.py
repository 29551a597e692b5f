from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture
from tests.ingest.prepared import assert_left_out, prepare

OPTIONS = IngestOptions()


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


def test_an_unreadable_folder_is_a_usage_error(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_args, **_options: False)
    with pytest.raises(UsageError, match="permission denied"):
        prepare(good)


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


def test_a_path_that_is_no_folder_is_a_usage_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        prepare_series(folder / "none", tmp_path / "p", OPTIONS)
    file = save(folder / "0.png", texture(0))
    with pytest.raises(UsageError, match="is not a folder"):
        prepare_series(file, tmp_path / "p", OPTIONS)


def test_a_file_of_a_format_that_is_not_read_says_what_to_save_it_as(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    file = folder / "tilt.DM3"
    file.write_bytes(b"\0\0\0\3")
    with pytest.raises(UsageError, match=r"tilt.DM3: .DM3 files are not read; save the images as"):
        find_images(file)
