"""Files and folders are there whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.atomic import (
    UNFINISHED,
    aside_path,
    file_aside,
    folder_aside,
    folder_filled,
    write_bytes,
    write_json,
    write_text,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write_half(path: Path) -> None:
    path.write_text("half")
    raise KeyboardInterrupt


def test_a_file_is_replaced_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    write_text("old", path)
    with file_aside(path) as aside:
        aside.write_text("half")
        assert path.read_text() == "old"
    assert path.read_text() == "half"
    assert names(path.parent) == ["a.txt"]


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text("old", path)
    with pytest.raises(KeyboardInterrupt), file_aside(path) as aside:
        write_half(aside)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_folder_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "maps"
    for number in range(2):
        with folder_aside(path) as aside:
            (aside / f"{number}").touch()
            assert names(path) == ["0"] if number else not path.exists()
    assert names(path) == ["1"]
    with pytest.raises(KeyboardInterrupt), folder_aside(path) as aside:
        write_half(aside / "2")
    assert names(path) == ["1"]
    assert names(tmp_path) == ["maps"]


def test_a_folder_that_was_cut_off_goes_on_where_its_key_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "maps"
    found = []

    def note_and_write_half(aside: Path) -> None:
        found.append(names(aside))
        write_half(aside / "1")

    for key, fresh in [("a", False), ("a", False), ("a", True), ("b", False)]:
        with pytest.raises(KeyboardInterrupt), folder_filled(path, key, fresh=fresh) as aside:
            note_and_write_half(aside)
        assert not path.exists()
    assert found == [[], ["1"], [], []]
    with folder_filled(path, "b", fresh=False) as aside:
        (aside / "2").touch()
    assert names(path) == ["1", "2"]
    assert names(tmp_path) == ["maps"]


def test_a_link_planted_for_a_folder_that_was_cut_off_is_not_followed(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    aside_path(tmp_path / "maps", f".a{UNFINISHED}").symlink_to(other)
    with folder_filled(tmp_path / "maps", "a", fresh=False) as aside:
        (aside / "1").touch()
    assert names(other) == []
    assert names(tmp_path / "maps") == ["1"]


def test_what_a_killed_process_left_is_no_part_of_the_next_folder(tmp_path: Path) -> None:
    left = aside_path(tmp_path / "maps")
    left.mkdir()
    (left / "stale").touch()
    aside_path(tmp_path / "maps", ".old").mkdir()
    with folder_aside(tmp_path / "maps") as aside:
        (aside / "new").touch()
    assert names(tmp_path / "maps") == ["new"]
    assert names(tmp_path) == ["maps"]


@pytest.mark.parametrize("letter", ["a", "ü", "像"])
def test_the_longest_names_can_be_written(tmp_path: Path, letter: str) -> None:
    stem = letter * (250 // len(letter.encode()))
    first, second = tmp_path / f"{stem}.1", tmp_path / f"{stem}.2"
    assert aside_path(first) != aside_path(second)
    write_text("1", first)
    write_text("2", second, shared=True)
    assert (first.read_text(), second.read_text()) == ("1", "2")


def test_two_processes_that_may_write_one_file_do_so_aside_of_each_other(tmp_path: Path) -> None:
    path = tmp_path / "a"
    assert str(os.getpid()) in aside_path(path, shared=True).name
    assert aside_path(path) == tmp_path / ".a.part"


def test_numpy_numbers_are_written_as_plain_ones(tmp_path: Path) -> None:
    write_json({"a": np.float32(0.5), "b": np.int64(3)}, tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": 0.5, "b": 3}


def test_a_place_that_cannot_be_written_is_a_usage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"a\.bin cannot be written \(.*\); check the output"):
        write_bytes(b"", tmp_path / "file" / "a.bin")
